import assert from 'node:assert/strict';
import { test } from 'node:test';
import { bits, count, degrees3, duration, number, ratio, signed, significant, stampSeconds, UNKNOWN, vector } from '../js/format.js';

test('numbers have their digits, and no minus before zero', () => {
  assert.equal(number(1.005, 1), '1.0');
  assert.equal(number(-0.001, 2), '0.00');
  assert.equal(number(-1.5, 1), '-1.5');
  assert.equal(vector([1, -2.25, 0], 3), '1.000 -2.250 0.000');
});

test('what is not known is a dash', () => {
  for (const nothing of [null, undefined, NaN, Infinity, '3']) assert.equal(number(nothing), UNKNOWN);
  assert.equal(vector(null), UNKNOWN);
  assert.equal(vector([1, null], 0), `1 ${UNKNOWN}`);
  assert.equal(ratio(undefined, 'a', 'b'), UNKNOWN);
  assert.equal(duration(NaN), UNKNOWN);
  assert.equal(significant(null), UNKNOWN);
});

test('small numbers show three digits that tell something', () => {
  assert.equal(significant(0.01234), '0.0123');
  assert.equal(significant(1.234), '1.23');
  assert.equal(significant(123.4), '123');
  assert.equal(significant(0), '0');
});

test('durations are in one or two units', () => {
  assert.equal(duration(1.234), '1.2 s');
  assert.equal(duration(59.9), '59 s');
  assert.equal(duration(125), '2 min 05 s');
  assert.equal(duration(3 * 3600 + 61), '3 h 01 min');
});

test('a stamp in nanoseconds loses nothing', () => {
  assert.equal(stampSeconds('1403715273262142976'), '1403715273.262');
  assert.equal(stampSeconds('5000000'), '0.005');
  assert.equal(stampSeconds('-1500000000'), '-1.500');
  assert.equal(stampSeconds(null), UNKNOWN);
  assert.equal(stampSeconds('1e9'), UNKNOWN);
});

test('counts are grouped and bits are hexadecimal', () => {
  assert.equal(count(1234567), '1\u2009234\u2009567');
  assert.equal(count(12), '12');
  assert.equal(bits(8), '0x0008');
  assert.equal(bits(null), UNKNOWN);
});

test('directions are three digits, and a full turn is zero', () => {
  assert.deepEqual([0, 7.4, 89.6, 359.6, -90, 720].map(degrees3), ['000', '007', '090', '000', '270', '000']);
  assert.equal(degrees3(null), UNKNOWN);
});

test('signed numbers show their sign, zero a plus', () => {
  assert.deepEqual([1.26, -1.26, 0, -0.01].map((x) => signed(x, 1)), ['+1.3', '-1.3', '+0.0', '+0.0']);
  assert.equal(signed(NaN), UNKNOWN);
});
