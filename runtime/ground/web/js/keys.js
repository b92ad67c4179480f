// Single keys, and the dialog that lists them. They can be switched off, for those who speak to their computer.

import { byId, recall, remember } from './dom.js';

// `commands` maps a key to what it does.
export function listenToKeys(commands) {
  const help = byId('help');
  const box = byId('keys-on');
  box.checked = recall('keys') !== 'off';
  box.addEventListener('change', () => remember('keys', box.checked ? 'on' : 'off'));
  const open = () => help.showModal();
  byId('help-open').addEventListener('click', open);
  byId('help-close').addEventListener('click', () => help.close());
  document.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
    if (!box.checked || document.querySelector('dialog[open]')) return;
    if (event.target.closest('select, textarea, input:not([type="radio"], [type="checkbox"])')) return;
    const command = event.key === '?' ? open : commands[event.key];
    if (!command) return;
    event.preventDefault();
    command();
  });
}
