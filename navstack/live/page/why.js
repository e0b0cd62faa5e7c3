// Questions and their answers: cards, and the trajectories of a control cycle on the map.
import { score } from './colors.js';
import { $, button, copy, el, poseText } from './dom.js';

const SHOWN = 10; // trajectories before "all"

export class Why {
  constructor(app) {
    this.app = app;
    this.fan = null; // of the answer that is shown: { rows: [sample, cost, points], best, sample, time, side }
    this.marked = null; // number of the trajectory under the pointer in the table
    this.asked = 0;
  }

  async ask(message, title, pose) {
    const { panel, connection } = this.app, section = $('tab-why'), number = ++this.asked, side = this.app.store.chosen;
    panel.show('why');
    this.clear();
    const text = el('pre', { id: 'answer', tabindex: 0 }, 'simulating again to find out …'), cards = el('div', { id: 'cards' });
    section.replaceChildren(el('h2', {}, title),
      pose ? el('div', { className: 'row' }, el('code', { id: 'pose-text' }, poseText(pose)), button('copy', 'Copy x,y,yaw', () => copy(poseText(pose)))) : '', cards, text);
    let answer;
    try { answer = await connection.request(this.app.about(message)); } catch (error) { answer = { text: error.message, data: { cards: [{ title: 'No answer', text: error.message, tone: 'bad' }] } }; }
    if (number !== this.asked) return; // another question came later
    const { cards: made = [], fan = null } = answer.data ?? {};
    this.fan = fan && { ...fan, side };
    cards.replaceChildren(...made.map((data) => this.card(data)));
    text.textContent = answer.text;
    if (made.length) {
      text.hidden = true;
      const shown = el('button', { type: 'button', className: 'outline', 'aria-expanded': 'false', onclick: () => { text.hidden = !text.hidden; shown.setAttribute('aria-expanded', String(!text.hidden)); } }, 'As text');
      text.before(el('div', { className: 'row' }, shown, button('copy', 'Copy the text', () => copy(answer.text))));
    }
    this.app.changed();
  }

  /** Takes the trajectories off the map. */
  clear() { this.fan = this.marked = null; this.app.changed(); }

  mark(sample) { this.marked = sample; this.app.changed(); }

  card({ title, text, tone, facts = [], bars = [], lines = [], samples = [] }) {
    return el('article', { className: `card ${tone ?? ''}` }, el('h3', {}, title), text ? el('p', {}, text) : null,
      facts.length ? el('dl', { className: 'facts' }, ...facts.map(([label, value]) => el('div', {}, el('dt', {}, label), el('dd', {}, value)))) : null,
      ...bars.map(([label, value, share, detail]) => {
        const fill = el('i');
        fill.style.width = `${Math.round(share * 100)}%`;
        return el('div', { className: 'bar', title: detail }, el('span', {}, label), el('b', {}, value), el('div', {}, fill), detail ? el('small', {}, detail) : null);
      }),
      lines.length ? el('ul', { className: 'lines' }, ...lines.map(([label, line, kind]) => el('li', { className: kind }, label ? el('b', {}, label) : null, el('span', {}, line)))) : null,
      samples.length ? this.table(samples) : null);
  }

  /** The trajectories by cost; one under the pointer is marked on the map, a click asks about it. */
  table(samples) {
    const sideways = samples.some((row) => Number(row[3]) !== 0), body = el('tbody');
    const row = ([sample, rank, vx, vy, wz, total, by]) => el('tr', {
      tabIndex: 0, className: rank === null ? 'rejected' : sample === this.fan?.best ? 'best' : '',
      onpointerenter: () => this.mark(sample), onfocus: () => this.mark(sample), onpointerleave: () => this.mark(null), onblur: () => this.mark(null),
      onclick: () => this.fan && this.sample(sample, this.fan.time), onkeydown: (e) => { if (e.key === 'Enter' && this.fan) this.sample(sample, this.fan.time); },
    }, ...[rank ?? '✕', vx, ...(sideways ? [vy] : []), wz, total === null ? '–' : Number(total.toPrecision(4)), by ?? ''].map((value) => el('td', {}, String(value))));
    const show = (count) => body.replaceChildren(...samples.slice(0, count).map(row));
    show(SHOWN);
    const all = el('button', { type: 'button', className: 'outline', onclick: () => { show(samples.length); all.remove(); } }, `All ${samples.length}`);
    return el('div', { className: 'scroll' }, el('table', { className: 'samples' },
      el('thead', {}, el('tr', {}, ...['', 'm/s', ...(sideways ? ['sideways'] : []), 'rad/s', 'cost', 'most of it, or rejected by'].map((name) => el('th', {}, name)))), body),
    samples.length > SHOWN ? all : null);
  }

  /** Draws the trajectories of the answer in the map frame. */
  draw(scene, side) {
    const { fan } = this, { theme } = this.app;
    if (!fan || side.index !== fan.side) return;
    const costs = fan.rows.map((row) => row[1]).filter((cost) => cost !== null), low = Math.min(...costs), high = Math.max(...costs), marked = this.marked ?? fan.sample;
    for (const [, cost, points] of fan.rows) {
      if (cost === null) scene.line(points, theme.bad, 0.9, [2, 4]);
      else scene.line(points, score(high > low ? (cost - low) / (high - low) : 0, this.app.layers.scheme), 1.4);
    }
    for (const [sample, color, width] of [[fan.best, theme.trajectory, 3.5], [marked, theme.accent, 5]]) {
      const row = fan.rows.find((item) => item[0] === sample);
      if (row) scene.line(row[2], color, width);
    }
  }

  cell(u, v, costmap) { const [x, y] = [u, v].map((value) => Math.round(value * 100) / 100); return this.ask({ type: 'explain_cell', x, y, costmap }, `Why this cost? (${costmap} costmap)`, [x, y, 0]); }
  command(time) { return this.ask({ type: 'explain_command', time: time === null ? null : Math.max(0, time) }, 'Why this command?'); }
  sample(sample, time) { return this.ask({ type: 'explain_command', time, sample }, 'Why (not) this trajectory?'); }
  goal(number) { return this.ask({ type: 'explain_goal', number }, 'What happened to this goal?'); }
  passage(x, y) { return this.ask({ type: 'explain_passage', x, y }, 'Can the robot pass?', [x, y, 0]); }
}
