// Two robots with different parameters in the same world: side by side or overlaid; which one the panel is about; the differences.
import { $, el, refresh } from './dom.js';

const KEY = 'navstack-live-overlaid';

export class Versus {
  constructor(app) {
    this.app = app;
    try { this.overlaid = localStorage.getItem(KEY) === 'true'; } catch { this.overlaid = false; }
    $('split').addEventListener('click', () => {
      this.overlaid = !this.overlaid;
      try { localStorage.setItem(KEY, String(this.overlaid)); } catch { /* storage is blocked */ }
      this.arrange();
    });
  }

  get two() { return this.app.store.sides.length > 1; }

  world(world) {
    $('split').hidden = $('which').hidden = !this.two;
    $('which').replaceChildren(...world.labels.map((label, index) => el('button', { type: 'button', role: 'radio', title: label, onclick: () => this.choose(index) },
      el('i', { className: index ? 'second' : 'first' }, '■'), label)));
    world.labels.forEach((label, index) => { $(`name${index + 1}`).textContent = label; });
    this.arrange();
    this.mark();
  }

  /** One canvas with both robots, or one each. */
  arrange() {
    const { app } = this, alone = this.two && !this.overlaid;
    for (const scene of app.scenes) scene.alone = alone;
    for (const id of ['scene2', 'name1', 'name2']) $(id).hidden = !alone;
    document.body.classList.toggle('split', alone);
    $('split').setAttribute('aria-pressed', String(alone));
    for (const scene of app.scenes) scene.resize();
    if (this.two) app.fit();
    app.changed();
  }

  choose(index) {
    const { app } = this;
    if (index === app.store.chosen) return;
    app.store.chosen = index;
    this.mark();
    app.panel.chosen();
    app.changed();
  }

  mark() { [...$('which').children].forEach((button, index) => button.setAttribute('aria-checked', String(index === this.app.store.chosen))); }

  update() {
    const box = $('versus'), { store } = this.app;
    box.hidden = !this.two || !store.sides.every((side) => side.pose);
    if (box.hidden) return;
    const rows = store.sides.map((side) => ({
      reached: side.goals.ended.filter((goal) => goal.state === 'SUCCEEDED').length, failed: side.goals.ended.filter((goal) => ['ABORTED', 'REJECTED', 'LOST'].includes(goal.state)).length,
      time: side.done ? side.goals.ended.reduce((sum, goal) => sum + goal.time, 0) : side.t, length: side.length, clearance: side.nearest ?? null,
    }));
    const difference = (key, digits, unit) => (rows[0][key] === null || rows[1][key] === null ? '–' : `${rows[1][key] >= rows[0][key] ? '+' : '−'}${Math.abs(rows[1][key] - rows[0][key]).toFixed(digits)}${unit}`);
    const cells = (name, row, extra) => el('tr', { className: extra }, el('td', {}, el('i', {}, '■ '), name), el('td', {}, `${row.reached}${row.failed ? ` (${row.failed} failed)` : ''}`),
      el('td', {}, `${row.time.toFixed(1)} s`), el('td', {}, `${row.length.toFixed(2)} m`), el('td', {}, row.clearance === null ? '–' : `${row.clearance.toFixed(2)} m`));
    refresh(box, JSON.stringify(rows), () => [el('table', {},
      el('tr', {}, el('th', {}, ''), el('th', {}, 'goals'), el('th', {}, 'time'), el('th', {}, 'driven'), el('th', {}, 'least clearance')),
      ...rows.map((row, i) => cells(store.world.labels[i], row, i ? 'second' : 'first')),
      el('tr', { className: 'difference' }, el('td', {}, 'difference'), el('td', {}, difference('reached', 0, '')), el('td', {}, difference('time', 1, ' s')), el('td', {}, difference('length', 2, ' m')), el('td', {}, difference('clearance', 2, ' m'))))]);
  }
}
