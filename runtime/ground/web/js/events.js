// The list of events, newest first, of bounded length.

import { byId, make } from './dom.js';
import { clock } from './format.js';

const MOST = 200;

export class Events {
  constructor(store) {
    this.store = store;
    this.list = byId('events');
    this.early = []; // that came before the station's clock was known
    byId('events-only').addEventListener('change', () => this.filter());
  }

  // An event of the station.
  receive(message) {
    if (!Number.isFinite(this.store.now)) {
      if (this.early.length < MOST) this.early.push(message);
      return;
    }
    const age = Number.isFinite(message.time_s) ? this.store.now - message.time_s : 0;
    this.add(new Date(Date.now() - 1000 * age), message.vehicle ?? null, message.severity, String(message.text ?? ''));
  }

  // The station's clock is known now.
  flush() {
    for (const message of this.early.splice(0)) this.receive(message);
  }

  // An event of this page.
  note(severity, text, vehicle = null) {
    this.add(new Date(), vehicle, severity, text);
  }

  add(date, vehicle, severity, text) {
    const kind = ['info', 'warning', 'error'].includes(severity) ? severity : 'info';
    const item = this.list.children.length >= MOST ? this.list.lastElementChild : make('li');
    item.replaceChildren();
    item.dataset.severity = kind;
    item.dataset.of = vehicle ?? '';
    const time = make('time', '', clock(date));
    time.dateTime = date.toISOString();
    item.append(time, ' ');
    if (kind !== 'info') item.append(make('b', 'severity', kind === 'error' ? 'error' : 'warning'), ' ');
    if (vehicle) item.append(make('span', 'of', vehicle), ' ');
    item.append(make('span', 'text', text.slice(0, 300)));
    item.hidden = this.isFiltered(item);
    this.list.prepend(item);
  }

  isFiltered(item) {
    return byId('events-only').checked && item.dataset.of !== '' && item.dataset.of !== this.store.selected;
  }

  filter() {
    for (const item of this.list.children) item.hidden = this.isFiltered(item);
  }
}
