import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Pace } from '../js/pace.js';

test('fast pictures are always due', () => {
  const pace = new Pace();
  assert.ok(pace.isDue(0));
  pace.drawn(100, 117);
  assert.ok(pace.isDue(117));
});

test('slow pictures leave twice their time to the rest of the page', () => {
  const pace = new Pace();
  pace.drawn(0, 300);
  assert.ok(!pace.isDue(800));
  assert.ok(pace.isDue(900));
});

test('a single hitch is soon forgotten, and no wait is longer than two seconds', () => {
  const pace = new Pace();
  pace.drawn(0, 60_000);
  assert.ok(pace.isDue(62_000));
  for (let i = 0; i < 25; i += 1) pace.drawn(0, 16);
  assert.ok(pace.isDue(17));
});
