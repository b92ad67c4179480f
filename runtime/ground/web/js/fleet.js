// The list of vehicles, one line each.

import { byId, glyph, make, setAttribute, setData, setStyle, setText } from './dom.js';
import { duration, number, UNKNOWN } from './format.js';
import { vehicleColour } from './palette.js';

export class FleetList {
  // `select` is called with the name of the vehicle that was chosen.
  constructor(store, select) {
    this.store = store;
    this.select = select;
    this.list = byId('fleet');
    this.entries = new Map();
    this.membership = -1;
    this.list.addEventListener('keydown', (event) => this.key(event));
  }

  update(theme) {
    const { store } = this;
    if (store.membership !== this.membership) this.rebuild();
    for (const vehicle of store.vehicles.values()) this.entries.get(vehicle.name).update(vehicle, store, theme);
    const flying = [...store.vehicles.values()].filter((v) => store.presence(v) === 'tracking').length;
    setText(byId('fleet-count'), store.vehicles.size ? `${flying} of ${store.vehicles.size} tracking` : '');
    byId('fleet-empty').hidden = store.vehicles.size > 0;
    setText(byId('fleet-empty'), store.attempt() || 'No vehicle received yet.');
  }

  // Entries in order of name; only when vehicles come or go.
  rebuild() {
    const { store } = this;
    this.membership = store.membership;
    for (const [name, entry] of this.entries) {
      if (store.vehicles.has(name)) continue;
      entry.item.remove();
      this.entries.delete(name);
    }
    const names = this.names();
    for (const name of names) {
      if (!this.entries.has(name)) this.entries.set(name, new Entry(name, () => this.select(name)));
    }
    const order = names.map((name) => this.entries.get(name).item);
    if (order.some((item, i) => this.list.children[i] !== item)) this.list.append(...order);
  }

  names() {
    return [...this.store.vehicles.keys()].sort((a, b) => a.localeCompare(b, 'en', { numeric: true }));
  }

  // Selects the vehicle `step` places further, or the first or last for an infinite step.
  move(step, focus = false) {
    const names = this.names();
    if (!names.length) return;
    const at = names.indexOf(this.store.selected) + step;
    const name = names[Math.max(0, Math.min(names.length - 1, at))];
    this.select(name);
    const { button } = this.entries.get(name);
    if (focus) button.focus();
    button.scrollIntoView({ block: 'nearest' });
  }

  key(event) {
    const step = { ArrowDown: 1, ArrowUp: -1, Home: -Infinity, End: Infinity }[event.key];
    if (step === undefined || event.altKey || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    this.move(step, true);
  }
}

class Entry {
  constructor(name, select) {
    this.item = make('li');
    this.button = make('button', 'entry');
    this.button.type = 'button';
    this.button.dataset.vehicle = name;
    this.button.addEventListener('click', select);
    this.swatch = make('i', 'swatch');
    this.swatch.setAttribute('aria-hidden', 'true');
    const label = make('span', 'name');
    label.append(this.swatch, make('span', '', name));
    label.title = name;
    const { svg, use } = glyph();
    this.use = use;
    this.word = make('span');
    this.state = make('span', 'state');
    this.state.append(svg, this.word);
    [this.quality, this.speed, this.link] = [
      ['quality', ' percent quality,'], ['speed', ' metres per second,'], ['link', ' percent link'],
    ].map(([kind, unit]) => {
      const cell = make('span', `figure ${kind}`);
      const value = make('span');
      cell.append(value, make('span', 'unseen', unit));
      this.button.append(cell);
      return value;
    });
    this.button.prepend(label, this.state);
    this.item.append(this.button);
  }

  update(vehicle, store, theme) {
    const { state } = vehicle;
    const presence = store.presence(vehicle);
    const isCurrent = store.isCurrent(vehicle);
    const isUsable = presence !== 'tracking' || state.usable !== false;
    setData(this.button, 'presence', presence);
    setData(this.button, 'usable', isUsable);
    setAttribute(this.button, 'aria-current', vehicle.name === store.selected);
    setStyle(this.swatch, 'background-color', vehicleColour(theme, vehicle.index));
    setAttribute(this.use, 'href', `#glyph-${presence}`);
    setText(this.word, isUsable ? shortPresence(presence, store.age(vehicle)) : 'not for use');
    setText(this.quality, isCurrent ? number(state.quality, 0) : UNKNOWN);
    setText(this.speed, isCurrent ? number(vehicle.speed, 1) : UNKNOWN);
    setText(this.link, isCurrent ? number(state.link?.quality, 0) : UNKNOWN);
  }
}

function shortPresence(presence, age) {
  if (presence === 'lost') return age === null ? 'link lost' : `lost ${brief(age)}`;
  if (presence === 'stale') return age === null ? 'stale' : `stale ${brief(age)}`;
  return presence;
}

function brief(age) {
  if (age < 10) return duration(age);
  if (age < 120) return `${Math.floor(age)} s`;
  return age < 36_000 ? `${Math.floor(age / 60)} min` : `${Math.floor(age / 3600)} h`;
}
