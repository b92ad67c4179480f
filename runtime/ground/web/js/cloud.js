// WebGL objects that show a SlidingArray without copying it.

import * as THREE from '../vendor/three/three.module.min.js';

// Draws the items of a SlidingArray of vertices as `Type` (Points, Line or LineSegments); only what is new is uploaded.
export class Cloud {
  constructor(Type, material, verticesPerItem = 1) {
    this.object = new Type(new THREE.BufferGeometry(), material);
    this.object.frustumCulled = false;
    this.verticesPerItem = verticesPerItem;
    this.seen = { source: null, array: null, moves: -1, appended: -1 };
  }

  // Shows what `source` holds now.
  update(source) {
    const { seen } = this;
    if (source === seen.source && source.appended === seen.appended && source.moves === seen.moves) return false;
    const floats = source.stride;
    if (source.array !== seen.array) {
      this.object.geometry.dispose();
      this.object.geometry = new THREE.BufferGeometry();
      const attribute = new THREE.BufferAttribute(source.array, 3);
      attribute.setUsage(THREE.DynamicDrawUsage);
      this.object.geometry.setAttribute('position', attribute);
    } else {
      const attribute = this.object.geometry.getAttribute('position');
      if (source === seen.source && source.moves === seen.moves) {
        const fresh = Math.min(source.appended - seen.appended, source.length);
        attribute.addUpdateRange((source.end - fresh) * floats, fresh * floats);
      } else {
        attribute.clearUpdateRanges();
        attribute.addUpdateRange(0, source.end * floats);
      }
      attribute.needsUpdate = true;
    }
    this.object.geometry.setDrawRange(source.start * this.verticesPerItem, source.length * this.verticesPerItem);
    Object.assign(seen, { source, array: source.array, moves: source.moves, appended: source.appended });
    return true;
  }

  // Draws at most the newest `count` items.
  showNewest(count) {
    const { source } = this.seen;
    const shown = Math.min(count, source.length);
    this.object.geometry.setDrawRange((source.end - shown) * this.verticesPerItem, shown * this.verticesPerItem);
  }

  dispose() {
    this.object.geometry.dispose();
  }
}

// Draws vertices that are replaced as a whole; the buffer grows and never shrinks.
export class Replaced {
  constructor(Type, material) {
    this.object = new Type(new THREE.BufferGeometry(), material);
    this.object.frustumCulled = false;
    this.capacity = 0;
  }

  set(vertices) {
    const { geometry } = this.object;
    if (vertices.length > this.capacity || this.capacity === 0) {
      // Whole vertices: what lies beyond the array counts as no number.
      this.capacity = Math.max(300, 3 * Math.ceil(0.5 * vertices.length));
      geometry.dispose();
      this.object.geometry = new THREE.BufferGeometry();
      const attribute = new THREE.BufferAttribute(new Float32Array(this.capacity), 3);
      attribute.setUsage(THREE.DynamicDrawUsage);
      this.object.geometry.setAttribute('position', attribute);
    }
    const attribute = this.object.geometry.getAttribute('position');
    attribute.array.set(vertices);
    attribute.needsUpdate = true;
    this.object.geometry.setDrawRange(0, vertices.length / 3);
  }

  dispose() {
    this.object.geometry.dispose();
  }
}
