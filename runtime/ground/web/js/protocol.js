// Parses what the station sends: a malformed message is null, never an exception.

const MAX_HEADER = 1 << 20;

// Reads a text frame: the object, if it has a type.
export function parseText(text) {
  let message;
  try {
    message = JSON.parse(text);
  } catch {
    return null;
  }
  return message && typeof message === 'object' && typeof message.type === 'string' ? message : null;
}

// Reads a camera picture: u32 little-endian N, N bytes of JSON, then the JPEG to the end. `jpeg` is a view, no copy.
export function parsePicture(buffer) {
  if (!(buffer instanceof ArrayBuffer) || buffer.byteLength < 4) return null;
  const length = new DataView(buffer).getUint32(0, true);
  if (length > MAX_HEADER || 4 + length >= buffer.byteLength) return null;
  let header;
  try {
    header = JSON.parse(new TextDecoder('utf-8', { fatal: true }).decode(new Uint8Array(buffer, 4, length)));
  } catch {
    return null;
  }
  if (!header || typeof header.vehicle !== 'string' || !(header.width > 0) || !(header.height > 0)) return null;
  return {
    vehicle: header.vehicle,
    stamp: String(header.stamp_ns ?? ''),
    width: header.width,
    height: header.height,
    points: numbers(header.points),
    lines: numbers(header.lines),
    jpeg: new Uint8Array(buffer, 4 + length),
  };
}

// An array of numbers as it is, anything else as an empty one.
export function numbers(value) {
  return Array.isArray(value) ? value : [];
}

// `count` finite numbers, or null.
export function tuple(value, count) {
  return Array.isArray(value) && value.length === count && value.every(Number.isFinite) ? value : null;
}

// Rows of numbers without their first `skip` columns, flat; rows that are too short or not finite are left out.
export function flatten(rows, skip, width) {
  if (!Array.isArray(rows)) return [];
  const out = [];
  for (const row of rows) {
    if (!Array.isArray(row) || row.length < skip + width) continue;
    const values = row.slice(skip, skip + width);
    if (values.every(Number.isFinite)) out.push(...values);
  }
  return out;
}

// Polylines of places as segments, both ends of each, flat; a place that is none breaks its line.
export function segments(lines) {
  const out = [];
  for (const line of numbers(lines)) {
    let before = null;
    for (const value of numbers(line)) {
      const place = tuple(value, 3);
      if (before && place) out.push(...before, ...place);
      before = place;
    }
  }
  return out;
}

export const PRESENCES = ['tracking', 'initialising', 'blind', 'failed', 'stale', 'lost', 'unknown'];

export function presenceOf(vehicle) {
  return PRESENCES.includes(vehicle?.presence) ? vehicle.presence : 'unknown';
}
