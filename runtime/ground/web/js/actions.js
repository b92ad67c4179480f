// Resets of the selected vehicle, and the download of its poses.

import { byId, make, setAttribute, setText } from './dom.js';

const TIMEOUT_MS = 8000;

const RESETS = {
  soft: {
    title: (name) => `Soft reset of ${name}?`,
    yes: 'Soft reset',
    text: [
      'The estimator starts anew and keeps its pose. Landmarks, velocity and biases are discarded; position and heading continue, with the drift so far.',
      'There is no valid odometry until it tracks again. The reset counter goes up by one.',
    ],
  },
  hard: {
    title: (name) => `Hard reset of ${name}?`,
    yes: 'Hard reset',
    text: [
      'The estimator starts anew at the origin and discards everything, its pose included: position jumps to 0 0 0 and heading to zero. The trajectory shown here begins anew.',
      'An autopilot that uses this odometry sees a jump: in flight, do this only in a mode that needs no position. The reset counter goes up by one.',
    ],
  },
};

export class Actions {
  constructor(store, events) {
    this.store = store;
    this.events = events;
    this.dialog = byId('confirm');
    this.pending = new Set(); // vehicles with a command under way
    this.asked = null; // vehicle and kind that the dialog asks about
    for (const kind of Object.keys(RESETS)) byId(`reset-${kind}`).addEventListener('click', () => this.ask(kind));
    byId('confirm-no').addEventListener('click', () => this.dialog.close());
    byId('confirm-yes').addEventListener('click', () => this.confirmed());
  }

  update() {
    const { vehicle, hello, isOpen } = this.store;
    const isBusy = this.pending.has(vehicle?.name);
    const isReachable = vehicle && isOpen && this.store.presence(vehicle) !== 'lost';
    for (const kind of Object.keys(RESETS)) {
      const button = byId(`reset-${kind}`);
      button.disabled = !isReachable || isBusy || !hello.commands;
      const title = hello.commands ? '' : 'Commands are off at this station: it was started with --no-commands, or serves other hosts without --allow-commands.';
      if (button.title !== title) button.title = title;
    }
    link(byId('trajectory'), vehicle && `api/vehicles/${encodeURIComponent(vehicle.name)}/trajectory.tum`);
  }

  ask(kind) {
    const name = this.store.selected;
    if (!name) return;
    this.asked = { name, kind };
    const words = RESETS[kind];
    setText(byId('confirm-title'), words.title(name));
    byId('confirm-text').replaceChildren(...words.text.map((text) => make('p', '', text)));
    setText(byId('confirm-yes'), words.yes);
    this.dialog.showModal();
  }

  async confirmed() {
    this.dialog.close();
    const { name, kind } = this.asked;
    await this.send(name, 'reset', { kind }, `${kind} reset`);
  }

  // Sends a command and shows its outcome.
  async send(name, path, body, what) {
    this.pending.add(name);
    this.report(`${name}: ${what} requested…`);
    this.update();
    const outcome = await post(`api/vehicles/${encodeURIComponent(name)}/${path}`, body);
    this.pending.delete(name);
    this.report(`${name}: ${outcome.text || `${what} ${outcome.ok ? 'done' : 'failed'}`}`, outcome.ok ? 'info' : 'error');
    if (!outcome.ok) this.events.note('error', `${what}: ${outcome.text}`, name);
    this.update();
  }

  report(text, severity = 'info') {
    const line = byId('action-state');
    setText(line, text);
    line.dataset.severity = severity;
  }
}

function link(anchor, href) {
  if (href) {
    setAttribute(anchor, 'href', href);
    if (!anchor.hasAttribute('download')) anchor.setAttribute('download', '');
    anchor.removeAttribute('aria-disabled');
    anchor.removeAttribute('role');
  } else if (anchor.getAttribute('aria-disabled') !== 'true') {
    anchor.removeAttribute('href');
    anchor.setAttribute('role', 'link');
    anchor.setAttribute('aria-disabled', 'true');
  }
}

async function post(url, body) {
  try {
    const response = await fetch(url, {
      method: 'POST',
      headers: { 'Content-Type': 'application/json' },
      body: JSON.stringify(body),
      signal: AbortSignal.timeout(TIMEOUT_MS),
    });
    const answer = await response.json().catch(() => null);
    return {
      ok: response.ok && answer?.ok !== false,
      text: String(answer?.text ?? (response.ok ? '' : `the station answered ${response.status}`)),
    };
  } catch (error) {
    const isLate = error.name === 'TimeoutError';
    return { ok: false, text: isLate ? `no answer within ${TIMEOUT_MS / 1000} s` : 'the station cannot be reached' };
  }
}
