import assert from 'node:assert/strict';
import { test } from 'node:test';
import { cross, dot, turn } from '../js/geometry.js';
import { HEADING_SCALE, headings, horizonTransform, PITCH_SCALE, rungs, tapeTransform } from '../js/horizon.js';

const RAD = Math.PI / 180;

function near(a, b, tolerance = 1e-9) {
  assert.ok(Math.abs(a - b) <= tolerance, `${a} is not ${b}`);
}

// Where a transform of the form "rotate(a) translate(0 y)" takes a point, as SVG defines it: y down, turning to the right.
function moved(transform, [x, y]) {
  const [, angle, shift] = /^rotate\((\S+)\) translate\(0 (\S+)\)$/.exec(transform).map(Number);
  const [c, s] = [Math.cos(angle * RAD), Math.sin(angle * RAD)];
  return [c * x - s * (y + shift), s * x + c * (y + shift)];
}

function product(a, b) {
  const [x1, y1, z1, w1] = a;
  const [x2, y2, z2, w2] = b;
  return [
    w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
    w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
    w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
    w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
  ];
}

function about(axis, degrees) {
  const half = (degrees / 2) * RAD;
  return [...axis.map((x) => x * Math.sin(half)), Math.cos(half)];
}

// Forward, left and up of a vehicle in O, by the definition of the angles: turn to the right, raise the nose, lower the right.
function vehicleAxes(roll, pitch, heading) {
  const q = product(product(about([0, 0, 1], -heading), about([0, 1, 0], -pitch)), about([1, 0, 0], roll));
  return [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => turn(q, 0, axis));
}

// Where the vehicle sees a direction of O: its angle from straight ahead, in units of the drawing, to the right and down.
function seen([forward, left, up], direction) {
  const angle = Math.atan2(Math.hypot(...cross(forward, direction)), dot(forward, direction)) / RAD;
  const [right, down] = [-dot(left, direction), -dot(up, direction)];
  const length = Math.hypot(right, down) || 1;
  return [(right / length) * angle * PITCH_SCALE, (down / length) * angle * PITCH_SCALE];
}

test('every rung of the ladder is drawn where the vehicle sees that elevation straight ahead', () => {
  for (const [roll, pitch, heading] of [[0, 0, 0], [0, 10, 0], [0, -25, 90], [20, 0, 0], [-35, 12, 200], [80, -40, 10], [170, 5, 300]]) {
    const axes = vehicleAxes(roll, pitch, heading);
    const transform = horizonTransform(roll, pitch);
    for (const elevation of [-30, -5, 0, 10, 45]) {
      const bearing = -heading * RAD; // clockwise from x
      const c = Math.cos(elevation * RAD);
      const direction = [c * Math.cos(bearing), c * Math.sin(bearing), Math.sin(elevation * RAD)];
      const drawn = moved(transform, [0, -elevation * PITCH_SCALE]);
      const expected = seen(axes, direction);
      near(drawn[0], expected[0], 2e-3 * PITCH_SCALE);
      near(drawn[1], expected[1], 2e-3 * PITCH_SCALE);
    }
  }
});

test('a raised nose lowers the horizon, a lowered right side turns it to the left', () => {
  assert.equal(horizonTransform(0, 0), 'rotate(0) translate(0 0)');
  near(moved(horizonTransform(0, 10), [0, 0])[1], 10 * PITCH_SCALE); // down
  const [, rightEnd] = moved(horizonTransform(30, 0), [100, 0]);
  near(rightEnd, -50, 1e-6); // the right end of the horizon has risen
});

test('the ladder has its rungs every five degrees, and none at the horizon', () => {
  const elevations = rungs().map((rung) => rung.elevation);
  assert.deepEqual([elevations[0], elevations.at(-1)], [-90, 90]);
  assert.ok(!elevations.includes(0));
  assert.equal(rungs().filter((rung) => rung.isLong).length, 18);
});

test('the tape has the heading in the middle, and marks on both sides of every heading', () => {
  const marks = headings();
  for (const heading of [0, 15, 180, 359.9]) {
    const shift = Number(/^translate\((\S+) 0\)$/.exec(tapeTransform(heading))[1]);
    const exact = marks.find((mark) => mark.at === 10 * Math.round(heading / 10));
    near(exact.at * HEADING_SCALE + shift, (exact.at - heading) * HEADING_SCALE, 1e-3);
    const places = marks.map((mark) => mark.at * HEADING_SCALE + shift);
    assert.ok(Math.min(...places) <= -100 && Math.max(...places) >= 100, `${heading}`);
  }
  const label = (at) => marks.find((mark) => mark.at === at).label;
  assert.deepEqual([label(-30), label(0), label(90), label(390)], ['330', '000', '090', '030']);
});
