import assert from 'node:assert/strict';
import { test } from 'node:test';
import { MAX_PATH, MAX_TRACK, Store } from '../js/store.js';

function state(name, more = {}) {
  return { name, presence: 'tracking', age_s: 0.01, pose: [1, 2, 3, 0, 0, 0, 1], velocity: [3, 4, 0], quality: 80, ...more };
}

function open() {
  const store = new Store();
  store.isOpen = true;
  return store;
}

function fleet(store, states, now = 10, at = 1000) {
  store.fleet({ type: 'fleet', now_s: now, vehicles: states }, at);
}

test('the first vehicle is selected, and another when it goes', () => {
  const store = open();
  fleet(store, [state('a'), state('b')]);
  assert.equal(store.selected, 'a');
  fleet(store, [state('b')]);
  assert.equal(store.selected, 'b');
  fleet(store, []);
  assert.equal(store.selected, null);
});

test('a vehicle keeps its colour while others come and go', () => {
  const store = open();
  fleet(store, [state('a'), state('b')]);
  const { index } = store.vehicles.get('b');
  fleet(store, [state('b'), state('c')]);
  assert.equal(store.vehicles.get('b').index, index);
  assert.notEqual(store.vehicles.get('c').index, index);
});

test('without a connection everything is stale, and ages go on', () => {
  const store = open();
  fleet(store, [state('a'), state('l', { presence: 'lost', age_s: 60 })], 10, 1000);
  const [a, lost] = store.vehicles.values();
  assert.equal(store.presence(a, 1100), 'tracking');
  store.isOpen = false;
  assert.equal(store.presence(a, 1100), 'stale');
  assert.equal(store.presence(lost, 1100), 'lost');
  assert.ok(Math.abs(store.age(a, 6000) - 5.01) < 1e-9);
  assert.equal(store.isCurrent(a, 1100), false);
});

test('a station that is silent makes vehicles stale too', () => {
  const store = open();
  fleet(store, [state('a')], 10, 1000);
  const [a] = store.vehicles.values();
  assert.equal(store.presence(a, 2000), 'tracking');
  assert.equal(store.presence(a, 4000), 'stale');
});

test('the age of a vehicle never heard is not known', () => {
  const store = open();
  fleet(store, [state('a', { age_s: null, presence: 'unknown', pose: null })]);
  assert.equal(store.age(store.vehicle), null);
  assert.equal(store.vehicle.pose, null);
});

test('a stale vehicle leaves a gap in its history', () => {
  const store = open();
  fleet(store, [state('a')], 1);
  fleet(store, [state('a', { presence: 'stale' })], 2);
  const out = [[], []];
  store.vehicle.history.window(0, 2, ['quality'], out);
  assert.deepEqual(out[1], [80, null]);
});

test('a track is appended to, begun anew, and bounded', () => {
  const store = open();
  fleet(store, [state('a')]);
  store.trackOf({ vehicle: 'a', reset: true, points: [[0, 1, 2, 3], [1, 4, 5, 6]] });
  store.trackOf({ vehicle: 'a', reset: false, points: [[2, 7, 8, 9]] });
  assert.equal(store.vehicle.track.length, 3);
  assert.equal(store.vehicle.track.newest(2), 9);
  store.trackOf({ vehicle: 'a', reset: true, points: [[3, 1, 1, 1]] });
  assert.equal(store.vehicle.track.length, 1);
  for (let i = 0; i < 30; i += 1) {
    store.trackOf({ vehicle: 'a', reset: false, points: Array.from({ length: 1000 }, () => [0, i, i, i]) });
  }
  assert.equal(store.vehicle.track.length, MAX_TRACK);
});

test('a new greeting forgets the space but not the history', () => {
  const store = open();
  fleet(store, [state('a')]);
  store.trackOf({ vehicle: 'a', reset: true, points: [[0, 1, 2, 3]] });
  store.mapOf({ vehicle: 'a', reset: false, keyframes: [[1, 0, 0, 0, 0, 0, 0, 1]], points: [1, 2, 3], lines: [1, 2, 3, 4, 5, 6] });
  assert.equal(store.vehicle.map.keyframes.length, 1);
  store.greeted({ version: '1', commands: false });
  assert.equal(store.hello.commands, false);
  assert.equal(store.vehicle.track.length, 0);
  assert.equal(store.vehicle.map.points.length, 0);
  assert.equal(store.vehicle.history.length, 1);
});

test('a corrected path replaces the one before, and is bounded', () => {
  const store = open();
  fleet(store, [state('a')]);
  store.correctedOf({ vehicle: 'a', pieces: [[[0, 0, 0], [1, 0, 0]]], loops: [] });
  store.correctedOf({ vehicle: 'a', pieces: [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[5, 5, 5]]], loops: [[[0, 0, 0], [1, 1, 0]]] });
  const { corrected } = store.vehicle;
  assert.deepEqual([corrected.poses, corrected.path.length, corrected.loops.length], [4, 12, 6]);
  store.correctedOf({ vehicle: 'a', pieces: [Array.from({ length: 9000 }, (_, i) => [i, 0, 0])], loops: 'x' });
  assert.ok(store.vehicle.corrected.path.length <= 6 * MAX_PATH);
  assert.deepEqual(store.vehicle.corrected.loops, []);
  assert.equal(store.vehicle.correctedVersion, 3);
});

test('messages that make no sense change nothing', () => {
  const store = open();
  store.fleet({ vehicles: 'x' }, 0);
  store.fleet({ now_s: 1, vehicles: [null, 7, {}, { name: '' }, { name: 3 }] }, 0);
  assert.equal(store.vehicles.size, 0);
  assert.equal(store.trackOf({ points: [] }), null);
  fleet(store, [state('a', { covariance: 'x', link: null, words: 3, attitude_deg: [1] })]);
  store.sceneOf({ vehicle: 'a', keyframes: 'x', points: null });
  assert.deepEqual(store.vehicle.scene, { keyframes: [], points: [], lines: [] });
});

test('without a vehicle the store says what the station tries, and is not connected', () => {
  const store = open();
  store.fleet({ type: 'fleet', now_s: 1, vehicles: [], network: 'Connecting to tcp/127.0.0.1:7447' }, 1000);
  assert.equal(store.connection(), 'waiting');
  assert.equal(store.attempt(), 'No vehicle received yet. Connecting to tcp/127.0.0.1:7447.');
  fleet(store, [state('a')]);
  assert.deepEqual([store.connection(), store.attempt()], ['open', '']);
  store.isOpen = false;
  assert.deepEqual([store.connection(), store.attempt()], ['closed', '']);
  store.isOpen = true;
  store.fleet({ type: 'fleet', now_s: 2, vehicles: [], network: { bad: 1 } }, 1100);
  assert.equal(store.attempt(), 'No vehicle received yet.');
});
