// Keeps the 3-D view from taking the whole machine where drawing is slow: numbers and strips come first.

const FAST_MS = 50; // a picture that takes less is drawn whenever there is something new
const LONGEST_MS = 2000;

export class Pace {
  constructor() {
    this.cost = 0; // ms from one picture to the next chance to draw, smoothed
    this.next = -Infinity;
  }

  isDue(at) {
    return at >= this.next;
  }

  // A picture begun at `from` was done by `to`, milliseconds: when slow, as long again is left to the others, twice over.
  drawn(from, to) {
    const cost = Math.max(0, to - from);
    this.cost = this.cost === 0 ? cost : 0.7 * this.cost + 0.3 * cost;
    this.next = this.cost < FAST_MS ? -Infinity : to + Math.min(LONGEST_MS, 2 * this.cost);
  }
}
