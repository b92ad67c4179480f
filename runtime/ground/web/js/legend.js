// The legend of the 3-D view: what each colour and sign stands for, in the colours that are drawn.

import { byId, make, setStyle } from './dom.js';
import { componentColour, sceneColours, vehicleColour } from './palette.js';

// Kind of sign, colour by theme, and words. `vehicle` is the colour of the selected vehicle.
const ENTRIES = [
  ['path', ({ vehicle }) => vehicle, 'trajectory'],
  ['dots', ({ vehicle }) => vehicle, 'landmarks in the window: points'],
  ['line', ({ vehicle }) => vehicle, 'lines in the window'],
  ['dots', ({ scene }) => scene.point, 'landmarks of the map: points'],
  ['line', ({ scene }) => scene.line, 'lines of the map'],
  ['frustum', ({ vehicle }) => vehicle, 'keyframe in the window'],
  ['frustum', ({ scene }) => scene.keyframe, 'keyframe of the map'],
  ['path', ({ scene }) => scene.label, 'path corrected by loops'],
  ['line', ({ scene }) => scene.loop, 'loop: a place seen again'],
  ['ellipse', ({ vehicle }) => vehicle, '3σ of the position'],
  ['dart', ({ scene }) => scene.keyframe, 'vehicle without current data'],
];

const AXES = ['x forward', 'y left', 'z up'];

// Paths in a box of 22 x 12; one that ends in "f" is filled.
const SIGNS = {
  path: 'M1 8 C6 1 12 12 21 4',
  line: 'M1 10 21 2',
  arrow: 'M1 10 20 3 M14 2 20 3 16 8',
  dots: 'M3 4h2v2h-2z M10 8h2v2h-2z M17 3h2v2h-2z f',
  frustum: 'M5 6 17 1V11Z M17 1 20 3 M17 11 20 9',
  ellipse: 'M2 6a9 4.5 0 1 0 18 0a9 4.5 0 1 0 -18 0 M2 6a9 1.8 0 1 0 18 0',
  dart: 'M20 6 3 1 7 6 3 11Z',
};

const SVG = 'http://www.w3.org/2000/svg';

function sign(kind) {
  const svg = document.createElementNS(SVG, 'svg');
  svg.setAttribute('viewBox', '0 0 22 12');
  svg.setAttribute('aria-hidden', 'true');
  const path = document.createElementNS(SVG, 'path');
  const isFilled = SIGNS[kind].endsWith(' f');
  path.setAttribute('d', SIGNS[kind].replace(/ f$/, ''));
  path.setAttribute('fill', isFilled ? 'currentColor' : 'none');
  if (!isFilled) path.setAttribute('stroke', 'currentColor');
  svg.append(path);
  return svg;
}

export class Legend {
  constructor() {
    const list = byId('legend-entries');
    this.items = ENTRIES.map(([kind, colour, words]) => {
      const item = make('li');
      const mark = sign(kind);
      item.append(mark, make('span', '', words));
      list.append(item);
      return { mark, colour };
    });
    this.axes = AXES.map((words, k) => {
      const item = make('li');
      const mark = sign('arrow');
      item.append(mark, make('span', '', `axis of the vehicle: ${words}`));
      list.append(item);
      return { mark, k };
    });
  }

  // Paints the signs in the colours of the theme and of the vehicle with this number.
  update(theme, index) {
    const colours = { scene: sceneColours(theme), vehicle: vehicleColour(theme, index) };
    for (const { mark, colour } of this.items) setStyle(mark, 'color', colour(colours));
    for (const { mark, k } of this.axes) setStyle(mark, 'color', componentColour(theme, k));
  }
}
