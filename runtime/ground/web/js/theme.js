// The theme, before anything is painted: a classic script, so that the page does not flash. `data-theme` on the root is
// what is in force, dark or light; a `themechange` event on the document says that it changed.
(() => {
  const CHOICES = ['auto', 'dark', 'light'];
  const KEY = 'plumbline.theme';
  const system = window.matchMedia('(prefers-color-scheme: light)');
  const root = document.documentElement;

  function remembered() {
    try {
      const choice = localStorage.getItem(KEY);
      return CHOICES.includes(choice) ? choice : 'auto';
    } catch {
      return 'auto';
    }
  }

  let choice = remembered();

  function apply() {
    const theme = choice === 'auto' ? (system.matches ? 'light' : 'dark') : choice;
    root.dataset.choice = choice;
    const name = document.getElementById('theme-name');
    if (name) name.textContent = choice;
    if (root.dataset.theme === theme) return;
    root.dataset.theme = theme;
    document.dispatchEvent(new CustomEvent('themechange'));
  }

  function next() {
    // The first step away from auto is the one that shows.
    const order = system.matches ? ['auto', 'dark', 'light'] : ['auto', 'light', 'dark'];
    choice = order[(order.indexOf(choice) + 1) % order.length];
    try {
      localStorage.setItem(KEY, choice);
    } catch {
      // Without storage the choice lasts as long as the page.
    }
    apply();
  }

  system.addEventListener('change', apply);
  document.addEventListener('DOMContentLoaded', () => {
    document.getElementById('theme').addEventListener('click', next);
    apply();
  });
  apply();
})();
