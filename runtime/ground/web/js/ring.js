// Typed buffers of bounded size. Both forget the oldest; neither allocates once it has its full size.

// Items of `stride` floats in one Float32Array, at most `limit` of them. The live items are contiguous, so that a
// vertex buffer can be made of `array` without a copy; when the end is reached they move to the front, once in
// `limit / 4` items.
export class SlidingArray {
  constructor(stride, limit) {
    this.stride = stride;
    this.limit = limit;
    this.array = new Float32Array(0);
    this.start = 0; // items
    this.end = 0;
    this.appended = 0; // items ever, so that a reader knows what is new
    this.epoch = 0; // how often it was cleared
    this.moves = 0; // how often items changed place, so that a reader knows when all is new
  }

  get length() {
    return this.end - this.start;
  }

  clear() {
    this.start = 0;
    this.end = 0;
    this.appended = 0;
    this.epoch += 1;
    this.moves += 1;
  }

  // Appends the items from `source`, flat numbers; an incomplete item at its end is left out.
  append(source) {
    let count = Math.floor(source.length / this.stride);
    let from = 0;
    this.appended += count;
    if (count > this.limit) {
      from = count - this.limit;
      count = this.limit;
    }
    this.makeRoom(count);
    const { array, stride } = this;
    let at = this.end * stride;
    for (let i = from * stride; i < (from + count) * stride; i += 1) array[at++] = source[i];
    this.end += count;
    this.start = Math.max(this.start, this.end - this.limit);
  }

  makeRoom(count) {
    const { stride, limit } = this;
    const most = limit + Math.ceil(limit / 4);
    if ((this.end + count) * stride <= this.array.length) return;
    const keep = Math.min(this.length, limit - count);
    const first = this.end - keep;
    const wanted = Math.min(most, Math.max(256, 2 * (keep + count)));
    if (wanted * stride > this.array.length) {
      const grown = new Float32Array(wanted * stride);
      grown.set(this.array.subarray(first * stride, this.end * stride));
      this.array = grown;
    } else {
      this.array.copyWithin(0, first * stride, this.end * stride);
    }
    this.start = 0;
    this.end = keep;
    this.moves += 1;
  }

  // Reads number `component` of the newest item, or NaN.
  newest(component) {
    return this.length ? this.array[(this.end - 1) * this.stride + component] : NaN;
  }
}

// A table of `names` over time: `time` in f64 seconds, the others in f32, at most `capacity` rows.
export class History {
  constructor(names, capacity) {
    this.capacity = capacity;
    this.time = new Float64Array(capacity);
    this.columns = Object.fromEntries(names.map((name) => [name, new Float32Array(capacity)]));
    this.names = names;
    this.head = 0; // where the next row goes
    this.length = 0;
  }

  clear() {
    this.head = 0;
    this.length = 0;
  }

  // Adds a row; a column that `row` does not have, or that is no number, becomes NaN. Time that runs backwards means
  // that the station was started anew: what was before is forgotten.
  push(time, row) {
    if (!Number.isFinite(time)) return;
    if (this.length && time < this.time[this.slot(this.length - 1)]) this.clear();
    this.time[this.head] = time;
    for (const name of this.names) {
      const value = row[name];
      this.columns[name][this.head] = typeof value === 'number' ? value : NaN;
    }
    this.head = (this.head + 1) % this.capacity;
    this.length = Math.min(this.length + 1, this.capacity);
  }

  // The place of row `index`, 0 being the oldest.
  slot(index) {
    return (this.head - this.length + index + this.capacity) % this.capacity;
  }

  // The index of the oldest row not older than `time`.
  firstSince(time) {
    let low = 0;
    let high = this.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time[this.slot(middle)] < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  // Writes rows since `from` into `out`: out[0] the time minus `now`, out[k] column names[k - 1], null where not known.
  window(from, now, names, out) {
    const first = this.firstSince(from);
    const rows = this.length - first;
    for (const series of out) series.length = rows;
    for (let i = 0; i < rows; i += 1) {
      const slot = this.slot(first + i);
      out[0][i] = this.time[slot] - now;
      for (let k = 0; k < names.length; k += 1) {
        const value = this.columns[names[k]][slot];
        out[k + 1][i] = Number.isNaN(value) ? null : value;
      }
    }
    return rows;
  }
}

// Angles that wrap draw a stroke across the whole strip: `gap` samples after a wrap are left out, as many as stand in the
// same column of pixels.
export function breakWraps(degrees, gap = 1) {
  let last = null;
  let leave = 0;
  for (let i = 0; i < degrees.length; i += 1) {
    const value = degrees[i];
    if (value !== null && last !== null && Math.abs(value - last) > 180) leave = gap;
    last = value;
    if (leave > 0) {
      degrees[i] = null;
      leave -= 1;
    }
  }
}
