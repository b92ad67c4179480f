// Panels that open and close, and the side column that hides; what was chosen is remembered.

import { byId, recall, remember } from './dom.js';

// As narrow as a phone: the legend would cover the 3-D view.
const NARROW = window.matchMedia('(max-width: 899px)');

// Every `details` with an id keeps its state from visit to visit.
export function rememberPanels() {
  for (const panel of document.querySelectorAll('details:is(.panel, .legend)[id]')) {
    const key = `panel.${panel.id}`;
    const kept = recall(key);
    if (kept !== null) panel.open = kept === 'open';
    let isFitted = false; // by the width, which is nobody's choice
    panel.addEventListener('toggle', () => {
      if (!isFitted) remember(key, panel.open ? 'open' : 'closed');
      isFitted = false;
    });
    if (panel.id !== 'legend') continue;
    const fit = () => {
      if (recall(key) !== null || panel.open === !NARROW.matches) return;
      isFitted = true;
      panel.open = !NARROW.matches;
    };
    NARROW.addEventListener('change', fit);
    fit();
  }
}

// The button that shows and hides the side column. Returns what toggles it.
export function sideToggle() {
  const button = byId('side-toggle');
  const show = (isShown) => {
    byId('side').hidden = !isShown;
    byId('desk').classList.toggle('wide', !isShown);
    button.setAttribute('aria-pressed', String(isShown));
    remember('side', isShown ? 'shown' : 'hidden');
  };
  if (recall('side') === 'hidden') show(false);
  const toggle = () => show(byId('side').hidden);
  button.addEventListener('click', toggle);
  return toggle;
}

// Opens or closes a panel.
export function togglePanel(id) {
  byId(id).open = !byId(id).open;
}
