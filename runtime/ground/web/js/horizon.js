// An artificial horizon: sky and ground, pitch ladder, roll scale and heading tape, drawn once as SVG and then only moved.
//
// Roll is positive with the right side down, pitch with the nose up, heading clockwise from above; all in degrees.

import { setAttribute, setData, setText } from './dom.js';
import { degrees3 } from './format.js';

const SVG = 'http://www.w3.org/2000/svg';
// Units of the drawing, which reaches 100 to either side, for a degree of pitch and of heading.
export const PITCH_SCALE = 2.4;
export const HEADING_SCALE = 1.8;
const ROLL_RADIUS = 86;
const ROLL_TICKS = [-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60];
const LADDER_REACH_DEG = 90;
const FAR = 1000;

// Moves horizon and pitch ladder, which are drawn for level flight: the nose raised by `pitch` lowers them, the right side
// lowered by `roll` turns them to the left. SVG turns to the right for positive angles, and its y points down.
export function horizonTransform(roll, pitch) {
  return `rotate(${fixed(-roll)}) translate(0 ${fixed(pitch * PITCH_SCALE)})`;
}

// Moves the tape so that `heading` (0 to 360) is in the middle.
export function tapeTransform(heading) {
  return `translate(${fixed(-heading * HEADING_SCALE)} 0)`;
}

// Rungs of the pitch ladder: elevation in degrees, half the length, and whether it has a number.
export function rungs() {
  const out = [];
  for (let elevation = -LADDER_REACH_DEG; elevation <= LADDER_REACH_DEG; elevation += 5) {
    if (elevation === 0) continue;
    const isLong = elevation % 10 === 0;
    out.push({ elevation, half: isLong ? 28 : 13, isLong });
  }
  return out;
}

// Marks of the heading tape: the tape goes on at both ends, so that north of its zero is never empty.
export function headings() {
  const out = [];
  for (let at = -60; at <= 420; at += 10) out.push({ at, label: at % 30 === 0 ? degrees3(at) : '' });
  return out;
}

function fixed(x) {
  return String(Math.round(x * 1000) / 1000 || 0);
}

export class Horizon {
  constructor(svg) {
    this.svg = svg;
    svg.setAttribute('viewBox', '-100 -100 200 234');
    draw(svg, 'clipPath', { id: 'horizon-window' }, (clip) => draw(clip, 'rect', { x: -100, y: -100, width: 200, height: 200, rx: 8 }));
    draw(svg, 'clipPath', { id: 'horizon-ladder' }, (clip) => draw(clip, 'rect', { x: -64, y: -66, width: 128, height: 136 }));
    draw(svg, 'clipPath', { id: 'horizon-tape' }, (clip) => draw(clip, 'rect', { x: -100, y: 106, width: 200, height: 28, rx: 6 }));
    draw(svg, 'g', { class: 'known', 'clip-path': 'url(#horizon-window)' }, (g) => {
      this.ball = draw(g, 'g', {}, drawBall);
      draw(g, 'g', { 'clip-path': 'url(#horizon-ladder)' }, (inner) => {
        this.ladder = draw(inner, 'g', { class: 'ladder' }, drawLadder);
      });
      drawRollScale(g);
      this.pointer = draw(g, 'path', { class: 'pointer', d: `M0 ${-ROLL_RADIUS + 1} l-6 11 h12 z` });
      drawVehicle(g);
    });
    draw(svg, 'g', { class: 'known', 'clip-path': 'url(#horizon-tape)' }, (g) => {
      draw(g, 'rect', { class: 'tape', x: -100, y: 106, width: 200, height: 28 });
      this.tape = draw(g, 'g', {}, drawTape);
    });
    draw(svg, 'g', { class: 'known' }, (g) => {
      draw(g, 'rect', { class: 'box', x: -25, y: 107, width: 50, height: 26, rx: 4 });
      this.heading = draw(g, 'text', { class: 'heading', x: 0, y: 126.5 });
    });
    draw(svg, 'g', { class: 'unknown' }, (g) => {
      draw(g, 'rect', { x: -100, y: -100, width: 200, height: 234, rx: 8 });
      draw(g, 'text', { x: 0, y: 20 }).textContent = 'no attitude';
    });
    this.update(null, false);
  }

  // `attitude` is [roll, pitch, heading], or null when it is unknown.
  update(attitude, isCurrent) {
    setData(this.svg, 'known', attitude !== null);
    setData(this.svg, 'current', isCurrent);
    if (attitude === null) {
      setAttribute(this.svg, 'aria-label', 'Artificial horizon: no attitude');
      return;
    }
    const [roll, pitch, heading] = attitude;
    const transform = horizonTransform(roll, pitch);
    setAttribute(this.ball, 'transform', transform);
    setAttribute(this.ladder, 'transform', transform);
    setAttribute(this.pointer, 'transform', `rotate(${fixed(-roll)})`);
    setAttribute(this.tape, 'transform', tapeTransform(heading));
    setText(this.heading, `${degrees3(heading)}°`);
    // For those who hear the page: whole degrees, so that it does not change all the time.
    setAttribute(this.svg, 'aria-label', `Artificial horizon: roll ${Math.round(roll)}°, pitch ${Math.round(pitch)}°, heading ${degrees3(heading)}°`);
  }
}

function draw(parent, tag, attributes, fill) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  parent.append(element);
  fill?.(element);
  return element;
}

function line(parent, x1, y1, x2, y2, more = {}) {
  return draw(parent, 'line', { x1, y1, x2, y2, ...more });
}

function drawBall(g) {
  draw(g, 'rect', { class: 'sky', x: -FAR, y: -FAR, width: 2 * FAR, height: FAR });
  draw(g, 'rect', { class: 'earth', x: -FAR, y: 0, width: 2 * FAR, height: FAR });
  line(g, -FAR, 0, FAR, 0, { class: 'edge' });
}

function drawLadder(g) {
  for (const { elevation, half, isLong } of rungs()) {
    const y = -elevation * PITCH_SCALE;
    line(g, -half, y, half, y, elevation < 0 ? { class: 'below' } : {});
    if (!isLong) continue;
    for (const side of [-1, 1]) {
      const text = draw(g, 'text', { x: side * (half + 4), y: y + 4.5, class: side < 0 ? 'left' : 'right' });
      text.textContent = String(Math.abs(elevation));
    }
  }
}

function drawRollScale(g) {
  draw(g, 'g', { class: 'roll' }, (scale) => {
    for (const tick of ROLL_TICKS) {
      const length = tick % 30 === 0 ? 11 : 6;
      line(scale, 0, -ROLL_RADIUS, 0, -ROLL_RADIUS - length, { transform: `rotate(${tick})` });
    }
  });
}

function drawVehicle(g) {
  draw(g, 'g', { class: 'vehicle' }, (vehicle) => {
    for (const className of ['rim', 'body']) {
      draw(vehicle, 'path', { class: className, d: 'M-62 0 h30 v8 M62 0 h-30 v8' });
      draw(vehicle, 'rect', { class: className, x: -2, y: -2, width: 4, height: 4 });
    }
  });
}

function drawTape(g) {
  for (const { at, label } of headings()) {
    const x = at * HEADING_SCALE;
    line(g, x, 106, x, label ? 112 : 110);
    if (label) draw(g, 'text', { x, y: 126 }).textContent = label;
  }
}
