// The 3-D view: all vehicles over a ground grid. Loaded on demand, so that the page lives without WebGL.

import * as THREE from '../vendor/three/three.module.min.js';
import { OrbitControls } from '../vendor/three/OrbitControls.js';
import { gridSpacing } from './geometry.js';
import { componentColour, sceneColours, vehicleColour } from './palette.js';
import { Vehicle3d } from './vehicle3d.js';

const HALF_CELLS = 60;
const PIECE_CELLS = 5;
const FIELD_OF_VIEW_DEG = 50;
const PICK_PX = 18;
// A path this much larger than when the camera was placed is out of view.
const OUTGROWN = 1.4;

export class View3d {
  // Throws when the browser has no WebGL. `labels` is an element over the canvas; `changed` asks for a new picture.
  constructor(canvas, labels, changed) {
    this.canvas = canvas;
    this.labels = labels;
    this.changed = changed;
    this.isSoftware = drawsInSoftware();
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !this.isSoftware, powerPreference: 'low-power' });
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW_DEG, 1, 0.02, 5000);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = Math.PI * 0.98;
    this.controls.minDistance = 0.2;
    this.controls.maxDistance = 3000;
    this.controls.listenToKeyEvents(canvas);
    this.controls.addEventListener('change', changed);
    this.controls.addEventListener('start', () => {
      this.isMoved = true;
    });
    this.vehicles = new Map();
    this.tags = new Map();
    this.scene.fog = new THREE.Fog(0, 1, 100);
    this.frame = 'odom';
    this.trails = 'short';
    this.landmarks = 'all';
    this.follows = true;
    this.followed = null; // where the followed vehicle was
    this.ellipsoidScale = 1;
    this.theme = 'dark';
    this.isPlaced = false;
    this.isMoved = false; // by the user since it was last placed
    this.projected = new THREE.Vector3();
    this.makeGrid();
    canvas.addEventListener('webglcontextlost', (event) => {
      event.preventDefault();
      this.isLost = true;
      this.onLost?.(true);
    });
    canvas.addEventListener('webglcontextrestored', () => {
      this.isLost = false;
      this.onLost?.(false);
      changed();
    });
    this.listenToClicks();
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
    this.resize();
    this.reset();
  }

  // A click on a vehicle, other than a drag, calls `onPick` with its name.
  listenToClicks() {
    let down = null;
    this.canvas.addEventListener('pointerdown', (event) => {
      down = event.isPrimary ? [event.offsetX, event.offsetY] : null;
    });
    this.canvas.addEventListener('pointerup', (event) => {
      if (!down || Math.hypot(event.offsetX - down[0], event.offsetY - down[1]) > 4) return;
      const name = this.nearest(event.offsetX, event.offsetY);
      if (name) this.onPick?.(name);
    });
  }

  // The vehicle drawn next to a place of the canvas, if there is one within PICK_PX.
  nearest(x, y) {
    let best = null;
    let least = PICK_PX;
    for (const [name, shown] of this.vehicles) {
      const place = this.project(shown);
      const distance = place ? Math.hypot(place[0] - x, place[1] - y) : Infinity;
      if (distance < least) [best, least] = [name, distance];
    }
    return best;
  }

  // Where a vehicle is drawn, in pixels of the canvas, or null when it is out of sight.
  project(shown) {
    const point = this.projected.copy(shown.position).project(this.camera);
    if (!shown.hasPose || point.z >= 1 || Math.abs(point.x) > 1.05 || Math.abs(point.y) > 1.05) return null;
    return [((point.x + 1) / 2) * this.width, ((1 - point.y) / 2) * this.height];
  }

  makeGrid() {
    const minor = [];
    const major = [];
    for (let i = -HALF_CELLS; i <= HALF_CELLS; i += 1) {
      const into = i % 10 === 0 ? major : minor;
      // In pieces: some drivers leave out a line that has an end far behind the camera.
      for (let from = -HALF_CELLS; from < HALF_CELLS; from += PIECE_CELLS) {
        const to = from + PIECE_CELLS;
        into.push(i, from, 0, i, to, 0, from, i, 0, to, i, 0);
      }
    }
    const lines = (vertices) => {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute('position', new THREE.Float32BufferAttribute(vertices, 3));
      const object = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial());
      object.frustumCulled = false;
      return object;
    };
    this.minor = lines(minor);
    this.major = lines(major);
    this.origin = lines([0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1]);
    this.scene.add(this.minor, this.major, this.origin);
    this.spacing = 1;
  }

  setTheme(theme) {
    this.theme = theme;
    const colours = sceneColours(theme);
    this.renderer.setClearColor(colours.ground);
    this.scene.fog.color.set(colours.ground);
    this.minor.material.color.set(colours.minor);
    this.major.material.color.set(colours.major);
    this.origin.material.color.set(colours.axis);
    this.changed();
  }

  resize() {
    const { clientWidth, clientHeight } = this.canvas.parentElement;
    if (!clientWidth || !clientHeight || (clientWidth === this.width && clientHeight === this.height)) return;
    this.width = clientWidth;
    this.height = clientHeight;
    this.renderer.setPixelRatio(this.isSoftware ? 1 : Math.min(window.devicePixelRatio || 1, 2));
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.changed();
  }

  // Looks from behind and above at what there is.
  reset() {
    this.look([-0.75, -0.9, 0.75]);
  }

  // Looks straight down, x to the right, y up.
  top() {
    this.look([0, -1e-4, 1]);
  }

  look(direction) {
    const { centre, radius } = this.extent();
    Object.assign(this, { direction, radius, isMoved: false });
    const distance = (1.25 * radius) / Math.sin((FIELD_OF_VIEW_DEG / 2) * (Math.PI / 180) * Math.min(1, this.camera.aspect));
    this.controls.target.copy(centre);
    this.camera.position.copy(centre).addScaledVector(new THREE.Vector3(...direction).normalize(), distance);
    this.controls.update();
    this.followed = null;
    this.changed();
  }

  // The followed vehicle's latest way, or all vehicles when none is followed.
  extent() {
    const box = new THREE.Box3();
    const point = new THREE.Vector3();
    const add = (name) => {
      const shown = this.vehicles.get(name);
      if (!shown) return;
      const source = shown.track.seen.source;
      const from = source ? Math.max(source.start, source.end - 2000) : 0;
      for (let i = from; source && i < source.end; i += 10) {
        box.expandByPoint(point.fromArray(source.array, 3 * i).applyMatrix4(shown.root.matrix));
      }
      if (shown.hasPose) box.expandByPoint(shown.position);
    };
    if (this.follows) add(this.selected);
    else for (const name of this.vehicles.keys()) add(name);
    if (box.isEmpty()) return { centre: new THREE.Vector3(), radius: 4 };
    const centre = box.getCenter(new THREE.Vector3());
    const shown = this.vehicles.get(this.selected);
    const radius = Math.min(400, Math.max(2, box.getSize(point).length() / 2));
    if (this.follows && shown?.hasPose) return { centre: shown.position.clone(), radius };
    return { centre, radius };
  }

  // Brings the scene up to date with the store; nothing is drawn yet.
  update(store) {
    const colours = sceneColours(this.theme);
    const componentColours = [0, 1, 2].map((k) => componentColour(this.theme, k));
    for (const name of this.vehicles.keys()) if (!store.vehicles.has(name)) this.remove(name);
    for (const vehicle of store.vehicles.values()) {
      let shown = this.vehicles.get(vehicle.name);
      if (!shown) {
        shown = new Vehicle3d(this.scene);
        this.vehicles.set(vehicle.name, shown);
        this.tags.set(vehicle.name, tag(this.labels, vehicle.name));
      }
      const look = {
        frame: this.frame,
        trails: this.trails,
        landmarks: this.landmarks,
        isSelected: vehicle.name === store.selected,
        isCurrent: store.isCurrent(vehicle),
        colour: vehicleColour(this.theme, vehicle.index),
        colours,
        componentColours,
        ellipsoidScale: this.ellipsoidScale,
      };
      shown.update(vehicle, look);
      this.tags.get(vehicle.name).show(store.presence(vehicle), look.isSelected, look.colour);
    }
    if (this.selected !== store.selected) this.followed = null;
    this.selected = store.selected;
    if (!this.isPlaced && store.vehicle?.pose) {
      this.isPlaced = true;
      this.reset();
    }
    this.startAgain(store.vehicle);
    this.widen();
    this.follow();
  }

  // A path that began anew, in an odometry frame of its own, is looked at as the first one was.
  startAgain(vehicle) {
    const path = vehicle ? `${vehicle.name} ${vehicle.track.epoch}` : '';
    const isNew = this.path !== undefined && this.path !== path;
    this.path = path;
    if (isNew && this.isPlaced && this.follows && !this.isMoved) this.look(this.direction);
  }

  // Keeps a path that grows in view, until the user has moved the camera.
  widen() {
    if (this.isPlaced && !this.isMoved && this.follows && this.extent().radius > OUTGROWN * this.radius) this.look(this.direction);
  }

  remove(name) {
    this.vehicles.get(name).dispose();
    this.vehicles.delete(name);
    this.tags.get(name).element.remove();
    this.tags.delete(name);
  }

  // Moves the camera with the selected vehicle.
  follow() {
    const shown = this.vehicles.get(this.selected);
    if (!this.follows || !shown?.hasPose) {
      this.followed = null;
      return;
    }
    if (!this.followed) {
      this.followed = this.controls.target.clone();
    }
    const step = shown.position.clone().sub(this.followed);
    this.camera.position.add(step);
    this.controls.target.add(step);
    this.followed.copy(shown.position);
  }

  setFollow(follows) {
    this.follows = follows;
    this.followed = null;
    this.changed();
  }

  // Draws. Returns the spacing of the grid in metres.
  draw() {
    if (this.isLost) return this.spacing;
    this.camera.updateMatrixWorld();
    const distance = this.camera.position.distanceTo(this.controls.target);
    this.camera.near = Math.max(0.01, distance / 500);
    this.camera.far = Math.max(200, distance * 50);
    this.camera.updateProjectionMatrix();
    this.placeGrid(distance);
    this.scene.fog.near = 1.2 * distance;
    this.scene.fog.far = 4.5 * distance;
    const perMetre = (2 * Math.tan((FIELD_OF_VIEW_DEG / 2) * (Math.PI / 180))) / this.height;
    for (const [name, shown] of this.vehicles) {
      shown.scaleMarker(perMetre * this.camera.position.distanceTo(shown.position), name === this.selected);
    }
    this.renderer.render(this.scene, this.camera);
    this.placeTags();
    return this.spacing;
  }

  placeGrid(distance) {
    this.spacing = gridSpacing(distance);
    const step = 10 * this.spacing;
    const { x, y } = this.controls.target;
    for (const grid of [this.minor, this.major]) {
      grid.scale.setScalar(this.spacing);
      grid.position.set(Math.round(x / step) * step, Math.round(y / step) * step, 0);
    }
    this.origin.scale.setScalar(this.spacing);
  }

  placeTags() {
    for (const [name, shown] of this.vehicles) {
      const { element } = this.tags.get(name);
      const place = this.project(shown);
      element.hidden = place === null;
      if (place) element.style.transform = `translate(${Math.round(place[0] + 9)}px, ${Math.round(place[1] - 20)}px)`;
    }
  }
}

// True if the processor has to do the work of a graphics processor: then smooth edges are too dear.
function drawsInSoftware() {
  const probe = document.createElement('canvas').getContext('webgl2');
  const info = probe?.getExtension('WEBGL_debug_renderer_info');
  const name = info ? String(probe.getParameter(info.UNMASKED_RENDERER_WEBGL)) : '';
  probe?.getExtension('WEBGL_lose_context')?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

// The name beside a vehicle.
function tag(labels, name) {
  const element = document.createElement('span');
  element.className = 'tag';
  element.textContent = name;
  labels.append(element);
  let shown = '';
  return {
    element,
    show(presence, isSelected, colour) {
      const now = `${presence} ${isSelected} ${colour}`;
      if (now === shown) return;
      shown = now;
      element.textContent = presence === 'tracking' ? name : `${name} · ${presence === 'lost' ? 'link lost' : presence}`;
      element.classList.toggle('selected', isSelected);
      element.style.setProperty('--vehicle', colour);
    },
  };
}
