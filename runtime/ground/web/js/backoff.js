// Wait before the next try, in milliseconds: 0.5 s doubled up to 10 s, spread by a quarter so that many pages
// do not come back together. `random` is in 0..1.
export function backoff(attempt, random = Math.random()) {
  const base = Math.min(10_000, 500 * 2 ** Math.min(attempt, 10));
  return Math.round(base * (0.875 + 0.25 * random));
}
