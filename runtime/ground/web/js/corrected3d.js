// The corrected path of a vehicle and its loops, in the map frame.

import * as THREE from '../vendor/three/three.module.min.js';
import { Replaced } from './cloud.js';

export class Corrected3d {
  constructor(scene) {
    // Coordinates of M inside; `root` takes them to the frame that is shown.
    this.root = new THREE.Group();
    this.root.matrixAutoUpdate = false;
    scene.add(this.root);
    this.pathMaterial = new THREE.LineBasicMaterial({ transparent: true, fog: false });
    this.loopMaterial = new THREE.LineBasicMaterial({ transparent: true, fog: false, depthWrite: false });
    this.path = new Replaced(THREE.LineSegments, this.pathMaterial);
    this.loops = new Replaced(THREE.LineSegments, this.loopMaterial);
    this.path.object.renderOrder = 3;
    this.loops.object.renderOrder = 4;
    this.root.add(this.path.object, this.loops.object);
    this.seen = { vehicle: null, version: -1 };
  }

  // `poseMO` takes coordinates of O to M, or is null while that is not known: then neither frame has a place for it, since the
  // vehicle is drawn in O.
  update(vehicle, look, poseMO) {
    const inMap = look.frame === 'map';
    this.root.visible = look.isSelected && poseMO !== null;
    if (!this.root.visible) return;
    this.root.matrix.identity();
    if (!inMap) compose(this.root.matrix, poseMO).invert();
    this.root.matrixWorldNeedsUpdate = true;
    const opacity = look.isCurrent ? 1 : 0.35;
    this.pathMaterial.color.set(inMap ? look.colour : look.colours.label);
    this.pathMaterial.opacity = opacity;
    this.loopMaterial.color.set(look.colours.loop);
    this.loopMaterial.opacity = 0.9 * opacity;
    const { seen } = this;
    if (seen.vehicle === vehicle && seen.version === vehicle.correctedVersion) return;
    this.path.set(vehicle.corrected.path);
    this.loops.set(vehicle.corrected.loops);
    Object.assign(seen, { vehicle, version: vehicle.correctedVersion });
  }

  dispose() {
    this.path.dispose();
    this.loops.dispose();
    this.pathMaterial.dispose();
    this.loopMaterial.dispose();
    this.root.removeFromParent();
  }
}

// The matrix of a pose x y z qx qy qz qw.
export function compose(matrix, pose) {
  const rotation = new THREE.Quaternion(pose[3], pose[4], pose[5], pose[6]);
  return matrix.compose(new THREE.Vector3(pose[0], pose[1], pose[2]), rotation, new THREE.Vector3(1, 1, 1));
}
