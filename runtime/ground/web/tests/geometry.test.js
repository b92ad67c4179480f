import assert from 'node:assert/strict';
import { test } from 'node:test';
import { CAMERA_IN_BODY, cross, dot, eigenSymmetric, ellipsoid, FRUSTUM_FLOATS, frusta, gridSpacing, norm, turn } from '../js/geometry.js';

function near(actual, expected, tolerance = 1e-12) {
  assert.ok(Math.abs(actual - expected) <= tolerance, `${actual} is not ${expected}`);
}

function random(seed) {
  let state = seed;
  return () => {
    state = (1664525 * state + 1013904223) % 4294967296;
    return state / 2147483648 - 1;
  };
}

test('eigenvalues and eigenvectors put the matrix together again', () => {
  const next = random(3);
  for (let trial = 0; trial < 200; trial += 1) {
    const m = Array.from({ length: 6 }, next);
    const { values, vectors } = eigenSymmetric(m);
    const full = [[m[0], m[1], m[2]], [m[1], m[3], m[4]], [m[2], m[4], m[5]]];
    for (let i = 0; i < 3; i += 1) {
      for (let j = 0; j < 3; j += 1) {
        near([0, 1, 2].reduce((sum, k) => sum + values[k] * vectors[k][i] * vectors[k][j], 0), full[i][j], 1e-12);
        near(dot(vectors[i], vectors[j]), i === j ? 1 : 0, 1e-12);
      }
    }
    assert.ok(values[0] >= values[1] && values[1] >= values[2]);
    near(dot(cross(vectors[0], vectors[1]), vectors[2]), 1, 1e-12);
  }
});

test('a diagonal covariance gives three sigma along the axes, largest first', () => {
  const { semiAxes, axes } = ellipsoid([0.01, 0, 0, 0.04, 0, 0.0025]);
  [0.6, 0.3, 0.15].forEach((length, k) => near(semiAxes[k], length));
  near(Math.abs(axes[0][1]), 1);
  near(Math.abs(axes[1][0]), 1);
});

test('a covariance that is turned gives an ellipsoid that is turned', () => {
  // Variances 0.09 along (1, 1, 0) and 0.01 along (1, -1, 0).
  const { semiAxes, axes } = ellipsoid([0.05, 0.04, 0, 0.05, 0, 0.0001]);
  near(semiAxes[0], 0.9, 1e-9);
  near(Math.abs(axes[0][0]), Math.SQRT1_2, 1e-9);
  near(axes[0][0], axes[0][1], 1e-9);
});

test('tiny and very unequal covariances are found to relative accuracy', () => {
  const { semiAxes } = ellipsoid([1e-10, 0, 0, 1e2, 0, 1e-4], 1);
  near(semiAxes[0], 10);
  near(semiAxes[2] / 1e-5, 1, 1e-6);
});

test('what is no covariance has no ellipsoid', () => {
  assert.equal(ellipsoid(null), null);
  assert.equal(ellipsoid([1, 2, 3]), null);
  assert.equal(ellipsoid([1, 0, 0, NaN, 0, 1]), null);
  assert.equal(ellipsoid([1, 0, 0, -1, 0, 1]), null);
  assert.ok(ellipsoid([0, 0, 0, 0, 0, 0]));
});

test('a quarter turn about z takes x to y', () => {
  const turned = turn([0, 0, Math.SQRT1_2, Math.SQRT1_2], 0, [1, 0, 2]);
  [0, 1, 2].forEach((value, k) => near(turned[k], value));
});

test('a frustum begins at its keyframe and opens along the camera', () => {
  const keyframes = [9, 9, 9, 0, 0, 0, 1, 1, 2, 3, 0, 0, 0, 1];
  const segments = frusta(keyframes, 1, 2, 0.5, CAMERA_IN_BODY);
  assert.equal(segments.length, FRUSTUM_FLOATS);
  assert.deepEqual([...segments.slice(0, 3)], [1, 2, 3]);
  near(segments[5], 3.5, 1e-6); // the camera looks along the body's z
  const edges = [];
  for (let i = 0; i < segments.length; i += 6) {
    edges.push(norm([0, 1, 2].map((k) => segments[i + k] - segments[i + 3 + k])));
  }
  edges.slice(1, 4).forEach((edge) => near(edge, edges[0], 1e-6));
});

test('the grid has steps of one, two or five', () => {
  assert.equal(gridSpacing(12), 1);
  assert.equal(gridSpacing(13), 2);
  assert.equal(gridSpacing(60), 5);
  assert.equal(gridSpacing(100), 10);
  near(gridSpacing(0.6), 0.05);
});
