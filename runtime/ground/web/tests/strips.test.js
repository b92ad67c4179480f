import assert from 'node:assert/strict';
import { test } from 'node:test';
import { STRIPS } from '../js/strips.js';

test('each strip has one unit, so that its axis means something', () => {
  const unitOf = { sigmaPosition: 'm', sigmaAttitude: '°', roll: '°', pitch: '°', vx: 'm/s', vy: 'm/s', vz: 'm/s', frameMs: 'ms', latencyMs: 'ms' };
  for (const { title, unit, columns } of STRIPS) {
    for (const column of columns) {
      if (column in unitOf) assert.equal(unit, unitOf[column], `${title}: ${column}`);
    }
  }
});
