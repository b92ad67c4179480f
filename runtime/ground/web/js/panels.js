// Panels that open and close, and the side column that hides; what was chosen is remembered.

import { byId, recall, remember } from './dom.js';

// Whether the 3-D view is as narrow as on a phone.
function isNarrow() {
  return window.matchMedia('(max-width: 899px)').matches;
}

// Every `details` with an id keeps its state from visit to visit.
export function rememberPanels() {
  for (const panel of document.querySelectorAll('details:is(.panel, .legend)[id]')) {
    const key = `panel.${panel.id}`;
    const kept = recall(key);
    if (kept !== null) panel.open = kept === 'open';
    else if (panel.id === 'legend' && isNarrow()) panel.open = false;
    panel.addEventListener('toggle', () => remember(key, panel.open ? 'open' : 'closed'));
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
