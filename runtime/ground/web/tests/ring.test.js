import assert from 'node:assert/strict';
import { test } from 'node:test';
import { breakWraps, History, SlidingArray } from '../js/ring.js';

function items(array) {
  return [...array.array.subarray(array.start * array.stride, array.end * array.stride)];
}

test('a sliding array keeps the newest items, in order and in one piece', () => {
  const array = new SlidingArray(2, 300);
  const expected = [];
  for (let i = 0; i < 5000; i += 1) {
    array.append([i, -i]);
    expected.push(i, -i);
    assert.deepEqual(items(array), expected.slice(-600));
  }
});

test('a sliding array never holds more than its limit and a quarter', () => {
  const array = new SlidingArray(3, 20_000);
  for (let i = 0; i < 400; i += 1) array.append(new Array(3 * 997).fill(i));
  assert.equal(array.length, 20_000);
  assert.ok(array.array.length <= 3 * 25_000);
  assert.equal(array.appended, 400 * 997);
});

test('more items at once than the limit leave the newest', () => {
  const array = new SlidingArray(1, 10);
  array.append([-2, -1]);
  array.append(Array.from({ length: 25 }, (_, i) => i));
  assert.deepEqual(items(array), [15, 16, 17, 18, 19, 20, 21, 22, 23, 24]);
});

test('an incomplete item is left out', () => {
  const array = new SlidingArray(3, 10);
  array.append([1, 2, 3, 4]);
  assert.deepEqual(items(array), [1, 2, 3]);
});

test('a reader sees in the counters what is new, what moved and what was cleared', () => {
  const array = new SlidingArray(1, 1000);
  array.append([1]);
  const { moves, epoch } = array;
  array.append([2]);
  assert.equal(array.moves, moves);
  assert.equal(array.appended, 2);
  array.clear();
  assert.notEqual(array.moves, moves);
  assert.equal(array.epoch, epoch + 1);
  assert.equal(array.length, 0);
  assert.ok(Number.isNaN(array.newest(0)));
});

test('a history forgets the oldest rows', () => {
  const history = new History(['a'], 5);
  for (let i = 0; i < 12; i += 1) history.push(i, { a: 10 * i });
  const out = [[], []];
  assert.equal(history.window(0, 11, ['a'], out), 5);
  assert.deepEqual(out, [[-4, -3, -2, -1, 0], [70, 80, 90, 100, 110]]);
});

test('a window begins with the first row in it, across the end of the ring', () => {
  const history = new History(['a', 'b'], 8);
  for (let i = 0; i < 11; i += 1) history.push(i, { a: i, b: -i });
  const out = [[], [], []];
  history.window(7.5, 10, ['b', 'a'], out);
  assert.deepEqual(out, [[-2, -1, 0], [-8, -9, -10], [8, 9, 10]]);
});

test('what is not known is a gap', () => {
  const history = new History(['a', 'b'], 8);
  history.push(1, { a: null, b: 'x' });
  history.push(2, {});
  history.push(NaN, { a: 1 });
  const out = [[], [], []];
  assert.equal(history.window(0, 2, ['a', 'b'], out), 2);
  assert.deepEqual(out.slice(1), [[null, null], [null, null]]);
});

test('a clock that runs backwards begins a new history', () => {
  const history = new History(['a'], 8);
  history.push(100, { a: 1 });
  history.push(3, { a: 2 });
  assert.equal(history.length, 1);
  assert.equal(history.firstSince(0), 0);
});

test('no stroke is drawn from +180 to -180 degrees', () => {
  const yaw = [170, 178, -176, -170, null, 10];
  breakWraps(yaw);
  assert.deepEqual(yaw, [170, 178, null, -170, null, 10]);
  const dense = [178, 179, -180, -179, -178, -177];
  breakWraps(dense, 3);
  assert.deepEqual(dense, [178, 179, null, null, null, -177]);
});
