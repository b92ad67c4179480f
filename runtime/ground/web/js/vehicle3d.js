// One vehicle in the 3-D view: trajectory and marker always; landmarks, keyframes, axes and ellipsoid when selected.

import * as THREE from '../vendor/three/three.module.min.js';
import { Cloud, Replaced } from './cloud.js';
import { compose, Corrected3d } from './corrected3d.js';
import { ellipsoid, FRUSTUM_FLOATS, frusta } from './geometry.js';
import { tuple } from './protocol.js';
import { SlidingArray } from './ring.js';
import { MAX_KEYFRAMES } from './store.js';

const KEYFRAME_M = 0.12;
// Points of the trajectory that a vehicle which is not selected draws, when trails are short.
const SHORT_TRAIL = 500;

export class Vehicle3d {
  constructor(scene) {
    this.scene = scene;
    // Coordinates of O inside; `root` takes them to the frame that is shown.
    this.root = new THREE.Group();
    this.root.matrixAutoUpdate = false;
    scene.add(this.root);
    this.trackMaterial = new THREE.LineBasicMaterial({ transparent: true, fog: false });
    this.track = new Cloud(THREE.Line, this.trackMaterial);
    this.markerMaterial = new THREE.MeshBasicMaterial({ fog: false, side: THREE.DoubleSide });
    this.marker = new THREE.Mesh(dart(), this.markerMaterial);
    this.axes = bodyAxes();
    this.body = new THREE.Group();
    this.body.add(this.marker, this.axes.object);
    this.root.add(this.track.object, this.body);
    this.corrected = new Corrected3d(scene);
    this.detail = null;
    this.position = new THREE.Vector3(); // in the frame that is shown
    this.hasPose = false;
  }

  // Brings the objects up to date. `look` has: frame, isSelected, isCurrent, trails (short or full), landmarks (all, window or
  // none), colour, colours, componentColours, ellipsoidScale.
  update(vehicle, look) {
    const poseMO = tuple(vehicle.state.correction, 7);
    const inMap = look.frame === 'map' && poseMO !== null;
    place(this.root.matrix, inMap ? poseMO : null);
    this.corrected.update(vehicle, look, poseMO);
    this.root.matrixWorldNeedsUpdate = true;
    this.track.update(vehicle.track);
    this.track.showNewest(look.isSelected || look.trails === 'full' ? Infinity : SHORT_TRAIL);
    this.trackMaterial.color.set(look.colour);
    // In the map frame the path of the odometry is only what the newest correction makes of it: the corrected one leads.
    const isSecond = inMap && look.isSelected && vehicle.corrected.poses > 1;
    this.trackMaterial.opacity = !look.isCurrent || isSecond ? 0.35 : look.isSelected ? 1 : 0.75;
    this.markerMaterial.color.set(look.isCurrent ? look.colour : look.colours.keyframe);
    this.markerMaterial.wireframe = !look.isCurrent;
    this.track.object.renderOrder = look.isSelected ? 2 : 1;
    // The vehicle's axes; those of the IMU as long as its mounting is unknown.
    const pose = vehicle.poseVehicle ?? vehicle.pose;
    this.hasPose = pose !== null;
    this.body.visible = this.hasPose;
    if (this.hasPose) {
      this.body.position.set(pose[0], pose[1], pose[2]);
      this.body.quaternion.set(pose[3], pose[4], pose[5], pose[6]);
      this.position.copy(this.body.position).applyMatrix4(this.root.matrix);
    }
    this.axes.object.visible = look.isSelected;
    if (look.isSelected) this.axes.paint(look.componentColours, look.isCurrent ? 1 : 0.4);
    if (look.isSelected) this.showDetail(vehicle, look);
    else this.dropDetail();
  }

  showDetail(vehicle, look) {
    this.detail ??= new Detail(this.root);
    this.detail.update(vehicle, look);
  }

  dropDetail() {
    this.detail?.dispose();
    this.detail = null;
  }

  // Keeps the marker at the same size on the screen, whatever the distance.
  scaleMarker(metresPerPixel, isSelected) {
    const size = (isSelected ? 11 : 8) * metresPerPixel;
    this.marker.scale.setScalar(size);
    this.axes.object.scale.setScalar(Math.max(0.3, 38 * metresPerPixel));
  }

  dispose() {
    this.dropDetail();
    this.corrected.dispose();
    this.track.dispose();
    this.marker.geometry.dispose();
    this.trackMaterial.dispose();
    this.markerMaterial.dispose();
    this.axes.dispose();
    this.scene.remove(this.root);
  }
}

// Parts that only the selected vehicle shows.
class Detail {
  constructor(root) {
    this.group = new THREE.Group();
    root.add(this.group);
    // Landmarks hide nothing that lies behind them: the trajectory is what is looked for.
    const line = () => new THREE.LineBasicMaterial({ transparent: true, fog: false, depthWrite: false });
    const dots = (size) => new THREE.PointsMaterial({ size, sizeAttenuation: false, transparent: true, fog: false, depthWrite: false });
    this.materials = {
      mapPoint: dots(1.6), mapLine: line(), mapKeyframe: line(), point: dots(3.4), line: line(), keyframe: line(),
      shell: new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.14, depthWrite: false, fog: false }),
      wires: new THREE.LineBasicMaterial({ transparent: true, opacity: 0.6, fog: false }),
    };
    const m = this.materials;
    this.mapPoints = new Cloud(THREE.Points, m.mapPoint);
    this.mapLines = new Cloud(THREE.LineSegments, m.mapLine, 2);
    this.mapKeyframes = new Cloud(THREE.LineSegments, m.mapKeyframe, FRUSTUM_FLOATS / 3);
    this.points = new Replaced(THREE.Points, m.point);
    this.lines = new Replaced(THREE.LineSegments, m.line);
    this.keyframes = new Replaced(THREE.LineSegments, m.keyframe);
    this.ellipsoid = new THREE.Group();
    this.ellipsoid.matrixAutoUpdate = false;
    this.shell = new THREE.Mesh(new THREE.SphereGeometry(1, 48, 32), m.shell);
    this.wires = new THREE.LineSegments(circles(), m.wires);
    this.ellipsoid.add(this.shell, this.wires);
    this.frusta = new SlidingArray(FRUSTUM_FLOATS, MAX_KEYFRAMES);
    this.frustaSeen = { source: null, epoch: -1, appended: 0 };
    this.sceneSeen = { vehicle: null, version: -1 };
    this.group.add(
      this.mapPoints.object, this.mapLines.object, this.mapKeyframes.object,
      this.points.object, this.lines.object, this.keyframes.object, this.ellipsoid,
    );
  }

  update(vehicle, look) {
    this.paint(look);
    this.mapPoints.update(vehicle.map.points);
    this.mapLines.update(vehicle.map.lines);
    this.expandKeyframes(vehicle.map.keyframes);
    this.mapKeyframes.update(this.frusta);
    this.choose(look.landmarks);
    const seen = this.sceneSeen;
    if (seen.vehicle !== vehicle || seen.version !== vehicle.sceneVersion) {
      const { scene } = vehicle;
      this.points.set(scene.points);
      this.lines.set(scene.lines);
      this.keyframes.set(frusta(scene.keyframes, 0, scene.keyframes.length / 7, KEYFRAME_M));
      Object.assign(seen, { vehicle, version: vehicle.sceneVersion });
    }
    this.showEllipsoid(vehicle, look.ellipsoidScale);
  }

  // Shows landmarks of the whole map, of the window, or none.
  choose(landmarks) {
    for (const part of [this.mapPoints, this.mapLines]) part.object.visible = landmarks === 'all';
    for (const part of [this.points, this.lines]) part.object.visible = landmarks !== 'none';
  }

  paint({ colour, colours, isCurrent }) {
    const m = this.materials;
    m.mapPoint.color.set(colours.point);
    m.mapLine.color.set(colours.line);
    m.mapKeyframe.color.set(colours.keyframe);
    for (const name of ['point', 'line', 'keyframe', 'shell', 'wires']) m[name].color.set(colour);
    const opacity = isCurrent ? 1 : 0.35;
    for (const name of ['point', 'line', 'keyframe']) m[name].opacity = opacity;
    m.mapPoint.opacity = 0.7;
    m.mapLine.opacity = 0.38;
    m.wires.opacity = 0.6 * opacity;
  }

  // Keyframes are stored as poses; only the new ones are made into segments.
  expandKeyframes(source) {
    const seen = this.frustaSeen;
    if (seen.source !== source || seen.epoch !== source.epoch) {
      this.frusta.clear();
      seen.appended = 0;
    }
    const fresh = Math.min(source.appended - seen.appended, source.length);
    if (fresh > 0) this.frusta.append(frusta(source.array, source.end - fresh, source.end, KEYFRAME_M));
    Object.assign(seen, { source, epoch: source.epoch, appended: source.appended });
  }

  showEllipsoid(vehicle, scale) {
    const shape = ellipsoid(vehicle.state.covariance);
    const { pose } = vehicle;
    this.ellipsoid.visible = Boolean(shape && pose);
    if (!this.ellipsoid.visible) return;
    const [a, b, c] = shape.axes.map((axis, k) => axis.map((x) => x * Math.max(shape.semiAxes[k], 1e-4) * scale));
    this.ellipsoid.matrix.set(
      a[0], b[0], c[0], pose[0],
      a[1], b[1], c[1], pose[1],
      a[2], b[2], c[2], pose[2],
      0, 0, 0, 1,
    );
    this.ellipsoid.matrixWorldNeedsUpdate = true;
  }

  dispose() {
    for (const part of [this.mapPoints, this.mapLines, this.mapKeyframes, this.points, this.lines, this.keyframes]) {
      part.dispose();
    }
    this.shell.geometry.dispose();
    this.wires.geometry.dispose();
    Object.values(this.materials).forEach((material) => material.dispose());
    this.group.removeFromParent();
  }
}

function place(matrix, pose) {
  if (pose) compose(matrix, pose);
  else matrix.identity();
}

// A dart of unit size that points along x, its fin along z.
function dart() {
  const nose = [1.3, 0, 0];
  const left = [-0.9, 0.85, 0];
  const right = [-0.9, -0.85, 0];
  const tail = [-0.5, 0, 0];
  const fin = [-0.75, 0, 0.55];
  const triangles = [nose, left, tail, nose, tail, right, nose, fin, tail];
  return new THREE.BufferGeometry().setAttribute('position', new THREE.Float32BufferAttribute(triangles.flat(), 3));
}

// Share of an axis that is the head of its arrow.
const HEAD = 0.16;

// Three unit axes as arrows with their letters.
function bodyAxes() {
  const object = new THREE.Group();
  const parts = ['x', 'y', 'z'].map((letter, k) => {
    const material = new THREE.LineBasicMaterial({ depthTest: false, transparent: true, fog: false });
    const end = [0, 0, 0];
    end[k] = 1;
    const geometry = new THREE.BufferGeometry();
    // Four strokes of the head, so that it is seen from every side.
    const strokes = [1, 2].flatMap((side) =>
      [-1, 1].map((sign) => {
        const back = end.map((x) => x * (1 - HEAD));
        back[(k + side) % 3] = (sign * HEAD) / 2;
        return [...end, ...back];
      }),
    );
    const points = [0, 0, 0, ...end, ...strokes.flat()];
    geometry.setAttribute('position', new THREE.Float32BufferAttribute(points, 3));
    const line = new THREE.LineSegments(geometry, material);
    const tip = new THREE.Sprite(new THREE.SpriteMaterial({ map: letterTexture(letter), depthTest: false, transparent: true, fog: false }));
    tip.position.set(...end.map((x) => 1.18 * x));
    tip.scale.setScalar(0.36);
    line.renderOrder = 5;
    tip.renderOrder = 6;
    object.add(line, tip);
    return { line, tip };
  });
  return {
    object,
    paint(colours, opacity) {
      parts.forEach(({ line, tip }, k) => {
        line.material.color.set(colours[k]);
        tip.material.color.set(colours[k]);
        line.material.opacity = opacity;
        tip.material.opacity = opacity;
      });
    },
    dispose() {
      for (const { line, tip } of parts) {
        line.geometry.dispose();
        line.material.dispose();
        tip.material.map.dispose();
        tip.material.dispose();
      }
    },
  };
}

function letterTexture(letter) {
  const canvas = document.createElement('canvas');
  canvas.width = 64;
  canvas.height = 64;
  const context = canvas.getContext('2d');
  context.font = '600 48px system-ui, sans-serif';
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  context.fillStyle = '#fff';
  context.fillText(letter, 32, 32);
  return new THREE.CanvasTexture(canvas);
}

// The three great circles of the unit sphere.
function circles() {
  const vertices = [];
  const n = 64;
  for (let axis = 0; axis < 3; axis += 1) {
    for (let i = 0; i < n; i += 1) {
      for (const j of [i, i + 1]) {
        const p = [0, 0, 0];
        p[(axis + 1) % 3] = Math.cos((2 * Math.PI * j) / n);
        p[(axis + 2) % 3] = Math.sin((2 * Math.PI * j) / n);
        vertices.push(...p);
      }
    }
  }
  return new THREE.BufferGeometry().setAttribute('position', new THREE.Float32BufferAttribute(vertices, 3));
}
