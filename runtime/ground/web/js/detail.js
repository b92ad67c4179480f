// Details of the selected vehicle, in numbers and words.

import { byId, make, setAttribute, setData, setStyle, setText } from './dom.js';
import * as f from './format.js';
import { ellipsoid } from './geometry.js';
import { Horizon } from './horizon.js';
import { tuple } from './protocol.js';

// Text of every element with this `data-field`.
const FIELDS = {
  'speed': (v) => f.number(v.speed, 2),
  'sigma-position': (v) => f.significant(v.state.sigma?.position_m),
  'sigma-attitude': (v) => f.significant(v.state.sigma?.attitude_deg),
  'sigma-velocity': (v) => f.significant(v.state.sigma?.velocity_m_s),
  'roll': (v) => f.signed(attitudeOf(v)?.[0], 1),
  'pitch': (v) => f.signed(attitudeOf(v)?.[1], 1),
  'heading': (v) => f.degrees3(attitudeOf(v)?.[2]),
  'height': (v) => f.signed(tuple(v.state.pose, 7)?.[2], 2),
  'climb': (v) => f.signed(tuple(v.state.velocity, 3)?.[2], 2),
  'ground-speed': (v) => f.number(groundSpeed(tuple(v.state.velocity, 3)), 2),
  'velocity': (v) => f.vector(v.state.velocity, 2),
  'rates': (v) => f.vector(v.state.rate_deg_s, 1),
  'position-map': (v) => f.vector(tuple(v.state.pose_map, 7)?.slice(0, 3), 3),
  'semi-axes': (v) => ellipsoid(v.state.covariance)?.semiAxes.map(f.significant).join(' ') ?? f.UNKNOWN,
  'stamp': (v) => f.stampSeconds(v.state.stamp_ns),
  'bad-stamps': (v) => badStamps(v.state.health?.sensors),
  'rung': (v) => v.state.health?.ladder?.name || f.UNKNOWN,
  'frame-ms': (v) => f.number(v.state.health?.frame_ms, 1),
  'frame-rate': (v) => f.number(v.state.health?.frame_rate_hz, 1),
  'points': (v) => f.ratio(v.state.figures, 'points_tracked', 'points_in_window'),
  'lines': (v) => f.ratio(v.state.figures, 'lines_matched', 'lines_in_window'),
  'keyframes': (v) => f.ratio(v.state.keyframes, 'have', 'total'),
  'bias-gyro': (v) => f.vector(v.state.bias_gyro?.map?.((x) => 1000 * x), 2),
  'bias-accel': (v) => f.vector(v.state.bias_accel, 3),
  'link-quality': (v) => f.number(v.state.link?.quality, 0),
  'odom-hz': (v) => f.number(v.state.link?.odom_hz, 1),
  'state-hz': (v) => f.number(v.state.link?.state_hz, 1),
  'latency': (v) => f.number(v.state.link?.latency_ms, 2),
  'rtt': (v) => f.number(v.state.link?.rtt_ms, 2),
  'offset': (v) => f.number(v.state.link?.offset_ms, 2),
  'lost': (v) => f.count(v.state.link?.lost),
  'dropped': (v) => f.count(v.state.health?.dropped),
  'bytes': (v) => f.number(v.state.link?.bytes_s / 1000, 1),
  'bits': (v) => `bits ${f.bits(v.state.bits)}`,
};

const NOBODY = { state: {}, speed: NaN };

// Roll, pitch and heading in degrees, or null.
function attitudeOf(vehicle) {
  return tuple(vehicle.state.attitude_deg, 3);
}

// Frames stamped by arrival, frames dropped and samples dropped for their stamps.
function badStamps(sensors) {
  const counts = [sensors?.frames?.restamped, sensors?.frames?.refused, sensors?.samples?.refused];
  return counts.every(Number.isFinite) ? counts.join(' / ') : f.UNKNOWN;
}

function groundSpeed(velocity) {
  return velocity ? Math.hypot(velocity[0], velocity[1]) : NaN;
}

// Health words that report a situation, not a fault.
const NOTICES = ['stationary'];

export class Detail {
  constructor(store) {
    this.store = store;
    this.elements = Object.keys(FIELDS).flatMap((field) =>
      [...document.querySelectorAll(`[data-field="${field}"]`)].map((element) => [element, FIELDS[field]]));
    this.age = document.querySelector('[data-field="age"]');
    this.horizon = new Horizon(byId('horizon'));
    this.shown = null; // lines of the health list
  }

  update() {
    const { store } = this;
    const { vehicle } = store;
    const presence = vehicle ? store.presence(vehicle) : 'unknown';
    const age = vehicle ? store.age(vehicle) : null;
    setData(document.body, 'current', vehicle ? store.isCurrent(vehicle) : false);
    setText(byId('vehicle-name'), vehicle?.name ?? 'No vehicle');
    const isUsable = presence === 'tracking' && vehicle.state.usable !== false;
    setData(byId('summary'), 'presence', presence);
    setData(byId('summary'), 'usable', isUsable);
    setAttribute(byId('presence-glyph'), 'href', `#glyph-${presence}`);
    setText(byId('presence'), presence === 'tracking' && !isUsable ? 'tracking, not for use' : presenceText(presence, age));
    setText(byId('position'), f.vector(vehicle?.pose?.slice(0, 3), 3));
    setText(byId('resets'), f.count(vehicle?.state.resets));
    setText(this.age, age === null ? f.UNKNOWN : age < 10 ? `${age.toFixed(2)} s` : f.duration(age));
    const quality = vehicle?.state.quality;
    // -1 says that there is no valid estimate.
    setText(byId('quality'), quality < 0 ? 'invalid' : f.number(quality, 0));
    byId('quality-unit').hidden = quality < 0;
    setStyle(byId('quality-bar'), 'transform', `scaleX(${Math.max(0, Math.min(100, quality || 0)) / 100})`);
    const isCurrent = vehicle ? store.isCurrent(vehicle) : false;
    // Of a vehicle that is gone it is the last value, and no colour says that it is good.
    setData(byId('quality-bar'), 'level', !isCurrent ? 'unknown' : quality >= 50 ? 'good' : quality >= 20 ? 'fair' : 'poor');
    for (const [element, text] of this.elements) setText(element, text(vehicle ?? NOBODY));
    this.horizon.update(vehicle ? attitudeOf(vehicle) : null, vehicle ? store.isCurrent(vehicle) : false);
    this.updateHealth(vehicle, presence, age);
    this.updateFault(vehicle, isUsable, presence);
  }

  // Banner of a fault with its cure: what the vehicle reports, or what its health bits say while its pose is not for use.
  updateFault(vehicle, isUsable, presence) {
    const isCurrent = vehicle ? this.store.isCurrent(vehicle) : false;
    const faults = isCurrent ? [...noticesOf(vehicle), ...(isUsable || presence === 'initialising' ? [] : texts(vehicle.state.advice, 40))] : [];
    byId('fault').hidden = !faults.length;
    const more = faults.length > 1 ? ` (and ${faults.length - 1} more: see Health)` : '';
    if (faults.length) setText(byId('fault'), `${isUsable ? '' : 'Do not use the pose: '}${faults[0]}${more}`);
  }

  updateHealth(vehicle, presence, age) {
    const words = texts(vehicle?.state.words, 40);
    const notes = [];
    if (presence === 'stale') notes.push(`no data for ${f.duration(age ?? NaN)}: showing the last values received`);
    if (presence === 'lost') notes.push(`link lost ${since(age)}: showing the last values received`);
    const notices = noticesOf(vehicle);
    const key = JSON.stringify([vehicle?.name, words, notes, notices]);
    if (key === this.shown) return;
    this.shown = key;
    const list = byId('words');
    const items = [...notes.map((text) => ['note', text]), ...notices.map((text) => ['fault', text]), ...words.map((text) => [NOTICES.includes(text) ? 'info' : 'fault', text])];
    if (!items.length) items.push(vehicle ? ['ok', 'no faults'] : ['note', 'no vehicle']);
    while (list.children.length > items.length) list.lastChild.remove();
    while (list.children.length < items.length) list.append(make('li'));
    items.forEach(([kind, text], i) => {
      setData(list.children[i], 'kind', kind);
      setText(list.children[i], text);
    });
  }
}

function texts(list, most) {
  return Array.isArray(list) ? list.slice(0, most).map(String) : [];
}

function noticesOf(vehicle) {
  return texts(vehicle?.state.health?.sensors?.notices, 16);
}

function presenceText(presence, age) {
  if (presence === 'lost') return `link lost ${since(age)}`; // the readout beside it has the age
  if (presence === 'stale') return age === null ? 'stale' : `stale for ${f.duration(age)}`;
  return presence;
}

function since(age) {
  if (age === null) return 'before any data came';
  return `since ${f.clock(new Date(Date.now() - 1000 * age))}`;
}
