// Everything that the page knows, and nothing that is drawn. Its memory is bounded per vehicle.

import { norm } from './geometry.js';
import { flatten, numbers, segments, presenceOf, tuple } from './protocol.js';
import { History, SlidingArray } from './ring.js';

export const MAX_TRACK = 20_000;
export const MAX_KEYFRAMES = 5_000;
export const MAX_POINTS = 60_000;
export const MAX_LINES = 20_000;
export const MAX_PATH = 2_000; // poses, and loops, of a corrected path
export const MAX_VEHICLES = 200;
const MAX_WORDS = 400;
const HISTORY_ROWS = 3_100; // five minutes at 10 Hz

export const HISTORY_COLUMNS = [
  'roll', 'pitch', 'vx', 'vy', 'vz', 'quality', 'link', 'faulty', 'sigmaPosition', 'sigmaAttitude',
  'frameMs', 'latencyMs', 'points', 'lines',
];

export class Vehicle {
  constructor(name, index) {
    this.name = name;
    this.index = index; // of its colour
    this.state = {};
    this.presence = 'unknown';
    this.history = new History(HISTORY_COLUMNS, HISTORY_ROWS);
    this.track = new SlidingArray(3, MAX_TRACK);
    this.map = {
      keyframes: new SlidingArray(7, MAX_KEYFRAMES),
      points: new SlidingArray(3, MAX_POINTS),
      lines: new SlidingArray(6, MAX_LINES),
    };
    this.scene = { keyframes: [], points: [], lines: [] };
    this.sceneVersion = 0;
    this.corrected = { path: [], loops: [], poses: 0 };
    this.correctedVersion = 0;
  }

  // Forgets what was sent once and will be sent again.
  forgetSpace() {
    this.track.clear();
    Object.values(this.map).forEach((array) => array.clear());
    this.scene = { keyframes: [], points: [], lines: [] };
    this.sceneVersion += 1;
    this.corrected = { path: [], loops: [], poses: 0 };
    this.correctedVersion += 1;
  }

  // Of the IMU's frame B in O: x y z qx qy qz qw.
  get pose() {
    return tuple(this.state.pose, 7);
  }

  // Of the vehicle's frame V (x forward, y left, z up) in O, where the mounting is known.
  get poseVehicle() {
    return tuple(this.state.pose_vehicle, 7);
  }

  // True if the display of it is of now.
  get isCurrent() {
    return !['stale', 'lost', 'unknown'].includes(this.presence);
  }

  get speed() {
    const velocity = tuple(this.state.velocity, 3);
    return velocity ? norm(velocity) : NaN;
  }
}

export class Store {
  constructor() {
    this.vehicles = new Map();
    this.selected = null;
    this.now = NaN; // the station's clock in seconds
    this.nowAt = NaN; // ours, when that was said, in milliseconds of performance.now()
    this.isOpen = false;
    this.hello = { version: '', commands: true };
    this.malformed = 0;
    this.refused = 0;
    this.network = ''; // what the station tries, in words
    this.nextIndex = 0;
    this.membership = 0; // grows when vehicles come or go
  }

  get vehicle() {
    return this.vehicles.get(this.selected) ?? null;
  }

  // The connection to the vehicles: "closed" without a station, "waiting" without a vehicle, else "open".
  connection() {
    if (!this.isOpen) return 'closed';
    return this.vehicles.size ? 'open' : 'waiting';
  }

  // Action of the station to reach a vehicle, as long as there is none; empty otherwise.
  attempt() {
    if (this.connection() !== 'waiting') return '';
    return this.network ? `No vehicle received yet. ${this.network}.` : 'No vehicle received yet.';
  }

  // Seconds since the station last spoke of the fleet.
  silence(at = performance.now()) {
    return Number.isFinite(this.nowAt) ? (at - this.nowAt) / 1000 : 0;
  }

  // Seconds since the last message of a vehicle, counted on while the station is silent. Null before the first.
  age(vehicle, at = performance.now()) {
    const age = vehicle.state.age_s;
    if (!Number.isFinite(age)) return null;
    const silence = this.silence(at);
    return age + (this.isOpen && silence < 1 ? 0 : silence);
  }

  // Words about a vehicle: without a connection, what was true has become stale.
  presence(vehicle, at = performance.now()) {
    if (this.isOpen && this.silence(at) < 1.5) return vehicle.presence;
    return vehicle.presence === 'lost' || vehicle.presence === 'unknown' ? vehicle.presence : 'stale';
  }

  isCurrent(vehicle, at = performance.now()) {
    return !['stale', 'lost', 'unknown'].includes(this.presence(vehicle, at));
  }

  get(name) {
    if (typeof name !== 'string' || name === '') return null;
    let vehicle = this.vehicles.get(name);
    if (!vehicle && this.vehicles.size < MAX_VEHICLES) {
      vehicle = new Vehicle(name, this.nextIndex);
      this.nextIndex += 1;
      this.vehicles.set(name, vehicle);
      this.membership += 1;
    }
    return vehicle ?? null;
  }

  fleet(message, at = performance.now()) {
    const now = Number.isFinite(message.now_s) ? message.now_s : at / 1000;
    this.now = now;
    this.nowAt = at;
    this.malformed = message.malformed ?? 0;
    this.refused = message.refused ?? 0;
    this.network = typeof message.network === 'string' ? message.network.slice(0, MAX_WORDS) : '';
    const present = new Set();
    for (const state of Array.isArray(message.vehicles) ? message.vehicles : []) {
      const vehicle = this.get(state?.name);
      if (!vehicle) continue;
      present.add(vehicle.name);
      vehicle.state = state;
      vehicle.presence = presenceOf(state);
      vehicle.history.push(now, historyRow(vehicle));
    }
    for (const name of [...this.vehicles.keys()]) {
      if (present.has(name)) continue;
      this.vehicles.delete(name);
      this.membership += 1;
    }
    if (!this.vehicles.has(this.selected)) this.selected = this.vehicles.keys().next().value ?? null;
  }

  // A new connection: the station sends its tracks and maps again, from the beginning.
  greeted(message) {
    this.hello = { version: String(message.version ?? ''), commands: message.commands !== false };
    for (const vehicle of this.vehicles.values()) vehicle.forgetSpace();
  }

  trackOf(message) {
    const vehicle = this.get(message.vehicle);
    if (!vehicle) return null;
    if (message.reset) vehicle.track.clear();
    vehicle.track.append(flatten(message.points, 1, 3));
    return vehicle;
  }

  mapOf(message) {
    const vehicle = this.get(message.vehicle);
    if (!vehicle) return null;
    const { keyframes, points, lines } = vehicle.map;
    if (message.reset) [keyframes, points, lines].forEach((array) => array.clear());
    keyframes.append(flatten(message.keyframes, 1, 7));
    points.append(numbers(message.points));
    lines.append(numbers(message.lines));
    return vehicle;
  }

  sceneOf(message) {
    const vehicle = this.get(message.vehicle);
    if (!vehicle) return null;
    vehicle.scene = {
      keyframes: flatten(message.keyframes?.slice?.(0, MAX_KEYFRAMES), 1, 7),
      points: numbers(message.points).slice(0, 3 * MAX_POINTS),
      lines: numbers(message.lines).slice(0, 6 * MAX_LINES),
    };
    vehicle.sceneVersion += 1;
    return vehicle;
  }

  // The corrected path and its loops replace those before.
  correctedOf(message) {
    const vehicle = this.get(message.vehicle);
    if (!vehicle) return null;
    const pieces = numbers(message.pieces).map((piece) => numbers(piece).slice(0, MAX_PATH));
    vehicle.corrected = {
      path: segments(pieces).slice(0, 6 * MAX_PATH),
      loops: segments(message.loops).slice(0, 6 * MAX_PATH),
      poses: pieces.reduce((count, piece) => count + piece.length, 0),
    };
    vehicle.correctedVersion += 1;
    return vehicle;
  }
}

// A row of the strips. What is stale leaves a gap instead of a flat line that looks like a measurement.
function historyRow(vehicle) {
  const { state } = vehicle;
  if (!vehicle.isCurrent) return {};
  const attitude = tuple(state.attitude_deg, 3) ?? [];
  const velocity = tuple(state.velocity, 3) ?? [];
  return {
    roll: attitude[0], pitch: attitude[1],
    vx: velocity[0], vy: velocity[1], vz: velocity[2],
    quality: state.quality,
    link: state.link?.quality,
    faulty: Array.isArray(state.words) && state.words.length > 0 ? 1 : 0,
    sigmaPosition: state.sigma?.position_m,
    sigmaAttitude: state.sigma?.attitude_deg,
    frameMs: state.health?.frame_ms,
    latencyMs: state.link?.latency_ms,
    points: state.figures?.points_tracked,
    lines: state.figures?.lines_matched,
  };
}
