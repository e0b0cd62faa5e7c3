// Two robots with different parameters in the same world: side by side, one above the other, or overlaid; which one the panel is about; the differences.
import { $, el, refresh } from './dom.js';

const KEY = 'navstack-live-arrangement', ARRANGEMENTS = ['beside', 'overlaid', 'stacked'];
const GAIN = 1.3; // a wide map is shown one above the other if that makes it larger by this factor

const narrow = () => matchMedia('(max-width: 760px)').matches;

export class Versus {
  constructor(app) {
    this.app = app;
    this.wanted = null; // an arrangement that the user has chosen
    try { this.wanted = localStorage.getItem(KEY); } catch { /* storage is blocked */ }
    $('split').addEventListener('click', () => {
      const choices = ARRANGEMENTS.filter((name) => name !== 'stacked' || !narrow());
      this.wanted = choices[(choices.indexOf(this.arrangement) + 1) % choices.length];
      try { localStorage.setItem(KEY, this.wanted); } catch { /* storage is blocked */ }
      this.arrange();
    });
  }

  /** How the two robots are shown; on a phone, side by side is one above the other. */
  get arrangement() {
    if (ARRANGEMENTS.includes(this.wanted) && !(this.wanted === 'stacked' && narrow())) return this.wanted;
    const { extent } = this.app.scene, box = $('stage').getBoundingClientRect();
    if (!extent || narrow()) return 'beside';
    const scale = (width, height) => Math.min(width / (extent[1] - extent[0]), height / (extent[3] - extent[2]));
    return scale(box.width, box.height / 2) > GAIN * scale(box.width / 2, box.height) ? 'stacked' : 'beside';
  }

  get overlaid() { return this.arrangement === 'overlaid'; }

  get two() { return this.app.store.sides.length > 1; }

  /** Pixels at the bottom of a map that the table covers. */
  get below() { return this.two && this.onStage ? ($('versus').offsetHeight || 84) + 20 : 0; }

  /** The table is in the panel, so that the maps have the stage; on the stage where the panel is closed or below the maps. */
  get onStage() { return narrow() || document.body.classList.contains('no-panel'); }

  place() {
    const box = $('versus');
    if (this.onStage !== (box.parentElement === $('stage'))) { if (this.onStage) $('stage').append(box); else $('which').after(box); }
  }

  world(world) {
    $('split').hidden = $('which').hidden = !this.two;
    $('which').replaceChildren(...world.labels.map((label, index) => el('button', { type: 'button', role: 'radio', title: label, onclick: () => this.choose(index) },
      el('i', { className: index ? 'second' : 'first' }, '■'), label)));
    world.labels.forEach((label, index) => { $(`name${index + 1}`).textContent = label; });
    this.arrange();
    this.mark();
  }

  /** One canvas with both robots, or one each; the map fills the place that it gets. */
  arrange() {
    const { app } = this, alone = this.two && !this.overlaid;
    this.place();
    for (const scene of app.scenes) scene.alone = alone;
    for (const id of ['scene2', 'name1', 'name2']) $(id).hidden = !alone;
    document.body.classList.toggle('split', alone);
    document.body.classList.toggle('stacked', alone && this.arrangement === 'stacked');
    document.body.classList.toggle('two', this.two);
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
    this.place();
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
