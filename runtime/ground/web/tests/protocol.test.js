import assert from 'node:assert/strict';
import { test } from 'node:test';
import { backoff } from '../js/backoff.js';
import { flatten, parsePicture, parseText, presenceOf, segments, tuple } from '../js/protocol.js';

function frame(header, jpeg, length = undefined) {
  const bytes = new TextEncoder().encode(typeof header === 'string' ? header : JSON.stringify(header));
  const buffer = new ArrayBuffer(4 + bytes.length + jpeg.length);
  new DataView(buffer).setUint32(0, length ?? bytes.length, true);
  new Uint8Array(buffer).set(bytes, 4);
  new Uint8Array(buffer).set(jpeg, 4 + bytes.length);
  return buffer;
}

const HEADER = { vehicle: 'Möwe', stamp_ns: '1403715273262142976', width: 376, height: 240, points: [1, 2, 0], lines: [1, 2, 3, 4] };

test('a picture is its header and the bytes behind it', () => {
  const picture = parsePicture(frame(HEADER, [0xff, 0xd8, 0xff]));
  assert.equal(picture.vehicle, 'Möwe');
  assert.equal(picture.stamp, '1403715273262142976');
  assert.deepEqual([picture.width, picture.height], [376, 240]);
  assert.deepEqual(picture.points, [1, 2, 0]);
  assert.deepEqual([...picture.jpeg], [0xff, 0xd8, 0xff]);
});

test('a picture without overlays has empty ones', () => {
  const picture = parsePicture(frame({ vehicle: 'a', width: 1, height: 1, points: null }, [1]));
  assert.deepEqual([picture.points, picture.lines, picture.stamp], [[], [], '']);
});

test('what is no picture is none', () => {
  assert.equal(parsePicture(new ArrayBuffer(0)), null);
  assert.equal(parsePicture(new ArrayBuffer(3)), null);
  assert.equal(parsePicture('text'), null);
  assert.equal(parsePicture(frame(HEADER, [1], 0xffffffff)), null);
  assert.equal(parsePicture(frame(HEADER, [1], 100_000)), null);
  assert.equal(parsePicture(frame(HEADER, [])), null);
  assert.equal(parsePicture(frame('{"vehicle":', [1])), null);
  assert.equal(parsePicture(frame('null', [1])), null);
  assert.equal(parsePicture(frame({ ...HEADER, width: 0 }, [1])), null);
  assert.equal(parsePicture(frame({ ...HEADER, vehicle: 7 }, [1])), null);
});

test('a text message is an object with a type', () => {
  assert.equal(parseText('{"type":"hello","x":1}').type, 'hello');
  for (const bad of ['', '{', 'null', '7', '[]', '{"type":3}', '{}']) assert.equal(parseText(bad), null);
});

test('tuples are complete and finite or nothing', () => {
  assert.deepEqual(tuple([1, 2, 3], 3), [1, 2, 3]);
  for (const bad of [null, undefined, [1, 2], [1, 2, null], 'abc', { length: 3 }]) assert.equal(tuple(bad, 3), null);
});

test('rows are flattened without their first columns, bad rows left out', () => {
  assert.deepEqual(flatten([[7, 1, 2, 3], [8, 4, 5], [9, 1, null, 3], 'x', [10, 4, 5, 6, 99]], 1, 3), [1, 2, 3, 4, 5, 6]);
  assert.deepEqual(flatten(undefined, 1, 3), []);
});

test('lines become segments, broken where a place is none', () => {
  assert.deepEqual(segments([[[1, 2, 3], [4, 5, 6], [7, 8, 9]], [[0, 0, 0]]]), [1, 2, 3, 4, 5, 6, 4, 5, 6, 7, 8, 9]);
  assert.deepEqual(segments([[[1, 2, 3], null, [4, 5, 6], [7, 8, 9]], 'x']), [4, 5, 6, 7, 8, 9]);
  assert.deepEqual(segments(undefined), []);
});

test('a presence that is not known is unknown', () => {
  assert.equal(presenceOf({ presence: 'blind' }), 'blind');
  assert.equal(presenceOf({ presence: 'toString' }), 'unknown');
  assert.equal(presenceOf(null), 'unknown');
});

test('tries to connect come ever less often, up to ten seconds', () => {
  const waits = Array.from({ length: 12 }, (_, i) => backoff(i, 0.5));
  assert.deepEqual(waits.slice(0, 5), [500, 1000, 2000, 4000, 8000]);
  assert.ok(waits.slice(5).every((wait) => wait === 10_000));
  assert.ok(backoff(3, 0) < backoff(3, 1));
});
