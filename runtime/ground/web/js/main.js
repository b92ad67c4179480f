// Joins the parts: messages go into the store, the store is drawn when something has changed.

import { Actions } from './actions.js';
import { Camera } from './camera.js';
import { Detail } from './detail.js';
import { byId, recall, remember, setData, setText } from './dom.js';
import { Events } from './events.js';
import { FleetList } from './fleet.js';
import { number } from './format.js';
import { listenToKeys } from './keys.js';
import { Legend } from './legend.js';
import { Link } from './link.js';
import { Pace } from './pace.js';
import { rememberPanels, sideToggle, togglePanel } from './panels.js';
import { Store } from './store.js';
import { Strips } from './strips.js';
import { tuple } from './protocol.js';

const STRIPS_EVERY_MS = window.matchMedia('(prefers-reduced-motion: reduce)').matches ? 1000 : 200;

const store = new Store();
const events = new Events(store);
const actions = new Actions(store, events);
const detail = new Detail(store);
const fleet = new FleetList(store, select);
const strips = new Strips(byId('strips'));
const legend = new Legend();
let view = null; // once WebGL is there
let link = null;
const camera = new Camera(store, (names) => link?.watch(names));

const dirty = { text: true, space: true, strips: true };
let isAsked = false; // whether a frame is asked for
let stripsAt = -Infinity;
const pace = new Pace();

function theme() {
  return document.documentElement.dataset.theme;
}

// Asks for a new picture of `parts`.
function changed(...parts) {
  for (const part of parts) dirty[part] = true;
  if (isAsked) return;
  isAsked = true;
  window.requestAnimationFrame(draw);
}

function draw(at) {
  isAsked = false;
  if (dirty.text) {
    dirty.text = false;
    fleet.update(theme());
    detail.update();
    actions.update();
    camera.update();
    legend.update(theme(), store.vehicle?.index ?? 0);
    setText(byId('map-note'), mapNote());
    updateStation();
  }
  setData(byId('view3d'), 'points', store.vehicle?.track.length ?? 0);
  setData(byId('view3d'), 'keyframes', store.vehicle?.map.keyframes.length ?? 0);
  setData(byId('view3d'), 'landmarks', store.vehicle?.map.points.length ?? 0);
  setData(byId('view3d'), 'loops', (store.vehicle?.corrected.loops.length ?? 0) / 6);
  setData(byId('view3d'), 'corrected', store.vehicle?.corrected.poses ?? 0);
  if (dirty.space && pace.isDue(at)) {
    dirty.space = false;
    if (view) {
      view.update(store);
      const spacing = view.draw();
      setText(byId('scale'), `grid ${length(spacing)}, bold lines ${length(10 * spacing)}`);
      setText(byId('frame-note'), frameNote());
      window.requestAnimationFrame(() => pace.drawn(at, performance.now()));
    }
    dirty.space = false; // drawing moves the camera, which asks again
  }
  if (dirty.strips && at - stripsAt >= STRIPS_EVERY_MS) {
    dirty.strips = false;
    stripsAt = at;
    strips.update(store.vehicle, store.now + (store.isOpen ? 0 : store.silence()));
  }
}

function length(metres) {
  return metres >= 1000 ? `${number(metres / 1000, 0)} km` : metres >= 1 ? `${number(metres, 0)} m` : `${number(100 * metres, 0)} cm`;
}

function frameNote() {
  if (view.frame === 'odom') return 'odometry frame O, z up';
  const correction = tuple(store.vehicle?.state.correction, 7);
  if (!correction) return 'map frame M: place in the map not known, drawn as O';
  return `map frame M: ${number(Math.hypot(correction[0], correction[1], correction[2]), 2)} m from O`;
}

// Map of the selected vehicle.
function mapNote() {
  const words = store.vehicle?.state.map;
  return typeof words === 'string' ? `map: ${words}` : '';
}

function updateStation() {
  setText(byId('malformed'), String(store.malformed));
  setText(byId('refused'), String(store.refused));
  setText(byId('version'), store.hello.version ? `Plumbline ${store.hello.version}` : '');
  const connection = byId('connection');
  setData(connection, 'state', store.connection());
  const attempt = store.attempt();
  byId('waiting').hidden = attempt === '';
  setText(byId('waiting'), attempt);
  const banner = byId('banner');
  if (store.isOpen) {
    const silence = store.silence();
    setText(byId('connection-text'), store.connection() === 'open' ? 'Connected' : 'No vehicle');
    banner.hidden = silence < 2;
    if (!banner.hidden) setText(banner, 'No data from the ground station: the values shown are old.');
    return;
  }
  setText(byId('connection-text'), 'Not connected');
  // Not on the first moment of a page that is just loading.
  banner.hidden = link === null || (link.attempt === 0 && !Number.isFinite(store.nowAt));
  if (!banner.hidden) setText(banner, 'No connection to the ground station: the values shown are old. Reconnecting.');
}

function select(name) {
  if (name === store.selected) return;
  store.selected = name;
  remember('vehicle', name);
  events.filter();
  stripsAt = -Infinity;
  changed('text', 'space', 'strips');
}

const handlers = {
  hello(message) {
    store.greeted(message);
    changed('text', 'space');
  },
  fleet(message) {
    const wasKnown = Number.isFinite(store.now);
    store.fleet(message);
    if (!wasKnown) {
      if (store.vehicles.has(recall('vehicle'))) store.selected = recall('vehicle');
      events.flush();
    }
    changed('text', 'space', 'strips');
  },
  track(message) {
    if (store.trackOf(message)) changed('space');
  },
  map(message) {
    if (store.mapOf(message)?.name === store.selected) changed('space');
  },
  scene(message) {
    if (store.sceneOf(message)?.name === store.selected) changed('space');
  },
  corrected(message) {
    if (store.correctedOf(message)?.name === store.selected) changed('space');
  },
  event(message) {
    events.receive(message);
  },
};

function connect() {
  const scheme = window.location.protocol === 'https:' ? 'wss:' : 'ws:';
  let wasOpen = false;
  link = new Link(`${scheme}//${window.location.host}/ws`, {
    open() {
      store.isOpen = true;
      if (wasOpen) events.note('info', 'connected to the station again');
      wasOpen = true;
      changed('text', 'space');
    },
    closed() {
      if (store.isOpen) events.note('error', 'connection to the station lost');
      store.isOpen = false;
      changed('text', 'space');
    },
    message(message) {
      if (Object.hasOwn(handlers, message.type)) handlers[message.type](message);
    },
    picture(picture) {
      camera.receive(picture);
    },
  });
  // Ages go on while no message comes.
  window.setInterval(() => {
    if (!store.isOpen || store.silence() > 1) changed('text', 'space', 'strips');
  }, 500);
}

async function openView() {
  const message = byId('view-message');
  const show = (text) => {
    message.hidden = text === '';
    setText(message, text);
  };
  try {
    const { View3d } = await import('./view3d.js');
    view = new View3d(byId('view3d'), byId('tags'), () => changed('space'));
    view.onLost = (isLost) => show(isLost ? 'The browser has lost the graphics processor. Waiting for it to be restored.' : '');
    view.onPick = select;
    view.setTheme(theme());
    changed('space');
  } catch {
    show('The 3-D view needs WebGL, which this browser does not offer. Enable hardware acceleration or use another browser. All else works.');
    for (const control of document.querySelectorAll('.view .tools :is(button, input, select)')) control.disabled = true;
  }
}

function setFollow(follows) {
  byId('follow').setAttribute('aria-pressed', String(follows));
  view?.setFollow(follows);
}

function setFrame(frame) {
  document.querySelector(`input[name="frame"][value="${frame}"]`).checked = true;
  if (!view) return;
  view.frame = frame;
  changed('space');
}

function setSpan(span) {
  document.querySelector(`input[name="span"][value="${span}"]`).checked = true;
  strips.span = Number(span);
  remember('span', span);
  stripsAt = -Infinity;
  changed('strips');
}

function listen() {
  byId('follow').addEventListener('click', () => setFollow(!view?.follows));
  byId('view-reset').addEventListener('click', () => view?.reset());
  byId('view-top').addEventListener('click', () => view?.top());
  byId('ellipsoid-scale').addEventListener('change', (event) => {
    if (view) view.ellipsoidScale = Number(event.target.value);
    changed('space');
  });
  for (const choice of ['trails', 'landmarks']) {
    byId(choice).addEventListener('change', (event) => {
      if (view) view[choice] = event.target.value;
      changed('space');
    });
  }
  for (const input of document.querySelectorAll('input[name="frame"]')) {
    input.addEventListener('change', () => setFrame(input.value));
  }
  for (const input of document.querySelectorAll('input[name="span"]')) {
    input.addEventListener('change', () => setSpan(input.value));
  }
  document.addEventListener('themechange', () => {
    view?.setTheme(theme());
    strips.setTheme(theme());
    changed('text', 'space', 'strips');
  });
  const toggleSide = sideToggle();
  listenToKeys({
    j: () => fleet.move(1),
    k: () => fleet.move(-1),
    f: () => setFollow(!view?.follows),
    v: () => view?.reset(),
    t: () => view?.top(),
    m: () => setFrame(view?.frame === 'odom' ? 'map' : 'odom'),
    1: () => setSpan('10'),
    2: () => setSpan('60'),
    3: () => setSpan('300'),
    s: toggleSide,
    h: () => togglePanel('history-panel'),
    c: () => togglePanel('camera-panel'),
    l: () => togglePanel('legend'),
    d: () => byId('theme').click(),
  });
}

strips.setTheme(theme());
rememberPanels();
listen();
if (['10', '60', '300'].includes(recall('span'))) setSpan(recall('span'));
connect();
openView();
changed('text', 'space', 'strips');
