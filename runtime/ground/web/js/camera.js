// The left camera's picture with what is tracked in it. It is asked for only while it can be seen.

import { byId, make, setText } from './dom.js';
import { duration } from './format.js';
import { ageColour, AGES } from './palette.js';

const STALE_S = 1.5;

export class Camera {
  // `watch` is told the names of the vehicles whose camera is wanted.
  constructor(store, watch) {
    this.store = store;
    this.watch = watch;
    this.panel = byId('camera-panel');
    this.canvas = byId('camera');
    this.context = this.canvas.getContext('2d');
    this.message = byId('camera-message');
    this.isSeen = false;
    this.isDecoding = false;
    this.waiting = null; // the newest picture that came while another was decoded
    this.shownOf = null;
    this.shownAt = 0;
    this.failed = 0;
    new IntersectionObserver((entries) => {
      this.isSeen = entries.at(-1).isIntersecting;
      this.update();
    }).observe(this.canvas.parentElement);
    this.panel.addEventListener('toggle', () => this.update());
    document.addEventListener('visibilitychange', () => this.update());
    for (const { colour, name } of AGES) {
      const key = make('span');
      const dot = make('i');
      dot.style.backgroundColor = colour;
      key.append(dot, name);
      byId('ages').append(key);
    }
  }

  get isWanted() {
    return this.isSeen && this.panel.open && !document.hidden;
  }

  update() {
    const { vehicle } = this.store;
    const offers = vehicle?.state.health?.offers_camera === true;
    this.watch(this.isWanted && offers ? [vehicle.name] : []);
    if (this.shownOf !== null && this.shownOf !== vehicle?.name) this.clear();
    const age = this.shownOf === null ? NaN : (performance.now() - this.shownAt) / 1000;
    const isStale = age > STALE_S;
    this.canvas.classList.toggle('stale', isStale);
    setText(byId('camera-age'), isStale ? `stale, ${duration(age)} old` : '');
    setText(this.message, this.reason(vehicle, offers));
    this.message.hidden = this.message.textContent === '';
  }

  reason(vehicle, offers) {
    if (!vehicle || this.shownOf !== null) return '';
    if (!offers) return 'This vehicle sends no camera images.';
    return this.store.isCurrent(vehicle) ? 'Waiting for an image.' : 'No images: no data from the vehicle.';
  }

  clear() {
    this.shownOf = null;
    this.waiting = null;
    this.canvas.dataset.stamp = '';
    this.context.clearRect(0, 0, this.canvas.width, this.canvas.height);
  }

  // Takes an image; older ones that still wait are left out.
  receive(picture) {
    if (picture.vehicle !== this.store.selected || !this.isWanted) return;
    this.waiting = picture;
    if (!this.isDecoding) this.decode();
  }

  async decode() {
    this.isDecoding = true;
    while (this.waiting) {
      const picture = this.waiting;
      this.waiting = null;
      try {
        const bitmap = await createImageBitmap(new Blob([picture.jpeg], { type: 'image/jpeg' }));
        if (picture.vehicle === this.store.selected) this.draw(picture, bitmap);
        bitmap.close();
      } catch {
        this.failed += 1; // a picture that is none; the next may be one
      }
    }
    this.isDecoding = false;
  }

  draw(picture, bitmap) {
    const { canvas, context } = this;
    const scale = Math.max(1, Math.min(2, Math.round(720 / bitmap.width)));
    const width = bitmap.width * scale;
    const height = bitmap.height * scale;
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(bitmap, 0, 0, width, height);
    // Overlays are in pixels of the picture that the header speaks of; a pixel's centre is at whole numbers.
    const sx = width / picture.width;
    const sy = height / picture.height;
    const x = (u) => (u + 0.5) * sx;
    const y = (v) => (v + 0.5) * sy;
    context.lineWidth = 1.5 * scale;
    context.strokeStyle = '#ff7ac8';
    context.beginPath();
    const { lines, points } = picture;
    for (let i = 0; i + 3 < lines.length; i += 4) {
      context.moveTo(x(lines[i]), y(lines[i + 1]));
      context.lineTo(x(lines[i + 2]), y(lines[i + 3]));
    }
    context.stroke();
    this.drawPoints(points, x, y, scale);
    canvas.dataset.stamp = picture.stamp;
    canvas.dataset.points = String(Math.floor(points.length / 3));
    this.shownOf = picture.vehicle;
    this.shownAt = performance.now();
    this.update();
  }

  // New points are rings, tracked ones discs with a dark rim, so that age is not told by colour alone.
  drawPoints(points, x, y, scale) {
    const { context } = this;
    context.lineWidth = scale;
    for (let i = 0; i + 2 < points.length; i += 3) {
      const age = points[i + 2];
      context.beginPath();
      context.arc(x(points[i]), y(points[i + 1]), (age === 0 ? 2.6 : 2.1) * scale, 0, 2 * Math.PI);
      if (age > 0) {
        context.fillStyle = ageColour(age);
        context.fill();
      }
      context.strokeStyle = age > 0 ? 'rgba(0,0,0,0.65)' : ageColour(0);
      context.stroke();
    }
  }
}
