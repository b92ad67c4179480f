// Strips over time: one small plot per subject, all with the same axis of time.

import { make, setText } from './dom.js';
import { number, significant } from './format.js';
import { componentColour, DASHES, sceneColours } from './palette.js';
import { breakWraps } from './ring.js';

const ANGLES = ['roll', 'pitch'];

export const STRIPS = [
  { title: 'Attitude', unit: '°', columns: ANGLES, labels: ANGLES, digits: 1, least: 10 },
  { title: 'Velocity in O', unit: 'm/s', columns: ['vx', 'vy', 'vz'], labels: ['x', 'y', 'z'], digits: 1, least: 0.5 },
  { title: 'Quality', unit: '%', columns: ['quality', 'link'], labels: ['estimate', 'link'], digits: 0, range: [-5, 105], shade: true },
  { title: 'Position 1σ', unit: 'm', columns: ['sigmaPosition'], labels: ['largest'], significant: true, zero: true, least: 0.01 },
  { title: 'Attitude 1σ', unit: '°', columns: ['sigmaAttitude'], labels: ['largest'], significant: true, zero: true, least: 0.1 },
  { title: 'Computation, latency', unit: 'ms', columns: ['frameMs', 'latencyMs'], labels: ['frame', 'link'], digits: 1, zero: true, least: 1 },
  { title: 'Features tracked', unit: '', columns: ['points', 'lines'], labels: ['points', 'lines'], digits: 0, zero: true, least: 10 },
];

export class Strips {
  constructor(container) {
    this.container = container;
    this.span = 60;
    this.theme = 'dark';
    this.uPlot = window.uPlot;
    if (!this.uPlot) {
      container.textContent = 'The plots cannot be drawn: uPlot did not load.';
      this.strips = [];
      return;
    }
    this.strips = STRIPS.map((spec) => this.makeStrip(spec));
    this.isVisible = true;
    new IntersectionObserver((entries) => {
      this.isVisible = entries.at(-1).isIntersecting;
    }).observe(container);
    new ResizeObserver(() => this.resize()).observe(container);
  }

  makeStrip(spec) {
    const figure = make('figure', 'strip');
    const caption = make('figcaption');
    const title = make('span', 'strip-title', spec.title);
    if (spec.unit) title.append(make('small', '', spec.unit));
    caption.append(title);
    const values = spec.columns.map((column, k) => {
      const key = make('span', 'key');
      key.dataset.component = String(k);
      const value = make('b');
      key.append(make('i'), make('span', '', spec.labels[k]), value);
      caption.append(key);
      return value;
    });
    const plot = make('div', 'plot');
    plot.setAttribute('role', 'img');
    plot.setAttribute('aria-label', `${spec.title} over time`);
    figure.append(caption, plot);
    this.container.append(figure);
    const columns = spec.shade ? [...spec.columns, 'faulty'] : spec.columns;
    const data = [[], ...columns.map(() => [])];
    const strip = { spec, values, plot, columns, data };
    strip.chart = new this.uPlot(this.options(strip), data, plot);
    return strip;
  }

  options(strip) {
    const { spec } = strip;
    const colours = () => sceneColours(this.theme);
    const axis = {
      font: '11px system-ui, sans-serif',
      stroke: () => colours().point,
      grid: { stroke: () => colours().minor, width: 1 },
      ticks: { show: false },
      gap: 3,
    };
    return {
      width: 300,
      height: 96,
      padding: [4, 14, 0, 0],
      legend: { show: false },
      cursor: { sync: { key: 'strips' }, drag: { setScale: false, x: false, y: false }, points: { size: 5 }, y: false },
      scales: { x: { time: false, range: () => [-this.span, 0] }, y: { range: (_, low, high) => range(spec, low, high) } },
      axes: [
        { ...axis, size: 18, space: 46, values: (_, ticks) => ticks.map((t) => ticksOf(t)) },
        { ...axis, size: 38, space: 22 },
      ],
      series: [
        {},
        ...spec.columns.map((_, k) => ({
          stroke: () => componentColour(this.theme, k),
          dash: DASHES[k],
          width: 1.25,
          points: { show: false },
          spanGaps: false,
        })),
        ...(spec.shade ? [{ show: false, scale: 'hidden' }] : []),
      ],
      hooks: {
        drawClear: spec.shade ? [(chart) => this.shade(chart, strip)] : [],
        setCursor: [() => this.showValues(strip)],
      },
    };
  }

  // Bands where a health bit was set.
  shade(chart, strip) {
    const [times] = strip.data;
    const faulty = strip.data.at(-1);
    const { ctx, bbox } = chart;
    ctx.save();
    ctx.fillStyle = this.theme === 'dark' ? 'rgba(232,178,58,0.22)' : 'rgba(180,95,0,0.18)';
    for (let i = 0; i < times.length; i += 1) {
      if (faulty[i] !== 1) continue;
      let end = i;
      while (end + 1 < times.length && faulty[end + 1] === 1) end += 1;
      const x0 = Math.max(bbox.left, chart.valToPos(times[i], 'x', true));
      const x1 = chart.valToPos(times[Math.min(end + 1, times.length - 1)], 'x', true);
      if (x1 > x0) ctx.fillRect(x0, bbox.top, Math.max(1, x1 - x0), bbox.height);
      i = end;
    }
    ctx.restore();
  }

  // The numbers in the caption: at the cursor, or the newest.
  showValues(strip) {
    const { spec, chart, data, values } = strip;
    const at = chart?.cursor?.idx ?? data[0].length - 1;
    const text = spec.significant ? significant : (x) => number(x, spec.digits);
    values.forEach((element, k) => setText(element, text(data[k + 1][at])));
  }

  update(vehicle, now) {
    if (!this.strips.length || !this.isVisible) return;
    for (const strip of this.strips) {
      const { data, columns, spec, chart } = strip;
      if (vehicle) vehicle.history.window(now - this.span, now, columns, data);
      else for (const series of data) series.length = 0;
      if (spec.columns === ANGLES) {
        const perPixel = (10 * this.span) / Math.max(1, chart.bbox.width / window.devicePixelRatio);
        for (const series of data.slice(1)) breakWraps(series, 1 + Math.ceil(perPixel));
      }
      chart.setData(data);
      this.showValues(strip);
    }
  }

  setTheme(theme) {
    this.theme = theme;
    for (const { chart } of this.strips) chart.redraw(false, true);
  }

  resize() {
    for (const { chart, plot } of this.strips) {
      const { clientWidth, clientHeight } = plot;
      if (clientWidth > 40 && (chart.width !== clientWidth || chart.height !== clientHeight)) {
        chart.setSize({ width: clientWidth, height: clientHeight });
      }
    }
  }
}

function range(spec, low, high) {
  if (spec.range) return spec.range;
  if (low === null || high === null || low === undefined || high === undefined) return [spec.zero ? 0 : -spec.least, spec.least];
  if (spec.zero) return [0, Math.max(spec.least, 1.1 * high)];
  const middle = (low + high) / 2;
  const half = Math.max(spec.least / 2, 0.55 * (high - low));
  return [middle - half, middle + half];
}

function ticksOf(seconds) {
  if (seconds === 0) return 'now';
  const text = seconds < -60 ? `${Math.round(seconds / 6) / 10} min` : `${seconds} s`;
  return text.replace('-', '−');
}
