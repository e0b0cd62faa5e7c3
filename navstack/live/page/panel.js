// The panel: robot, goals, layers, parameters, why.
import { Chart } from './charts.js';
import { $, button, copy, el, fixed, nextNumber, poseText, refresh, toast } from './dom.js';

const TABS = [['robot', 'Robot'], ['goals', 'Goals'], ['graph', 'Routes'], ['layers', 'Layers'], ['parameters', 'Parameters'], ['why', 'Why'], ['tree', 'Tree']];
const SIZE = 'navstack-live';
const STATES = { SUCCEEDED: 'good', ABORTED: 'bad', REJECTED: 'bad', LOST: 'bad', PREEMPTED: 'warn', RECALLED: 'warn' };
const ROUTINE = new Set(['plan', 'info']); // they do not end a row of others
const EVENTS = { plan_failed: 'warn', control_failed: 'warn', recovery: 'warn', warning: 'warn', collision: 'bad' };

export class Panel {
  constructor(app) {
    this.app = app;
    $('tabs').append(...TABS.map(([name, label]) => el('button', { type: 'button', role: 'tab', id: `show-${name}`, 'aria-controls': `tab-${name}`, onclick: () => this.show(name) }, label)));
    $('tabs').addEventListener('keydown', (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      const names = TABS.map(([name]) => name).filter((name) => !$(`show-${name}`).hidden), next = names[(names.indexOf(this.shown) + step + names.length) % names.length];
      this.show(next);
      $(`show-${next}`).focus();
      event.stopPropagation();
    });
    this.buildRobot();
    this.buildGoals();
    $('tab-why').append(el('p', { className: 'empty' }, 'Click a cell, a trajectory, a goal, an opening or a chart: here is why.'));
    this.show('robot');
    this.resizable($('grip'));
  }

  /** The edge of the panel: dragged, or moved by arrow keys; its width (its height on a phone) is kept in the browser. */
  resizable(grip) {
    const style = document.documentElement.style, narrow = () => matchMedia('(max-width: 760px)').matches;
    const size = () => { const box = $('panel').getBoundingClientRect(); return narrow() ? box.height : box.width; };
    const set = (wanted) => {
      const [name, least, most] = narrow() ? ['--sheet', 140, innerHeight * 0.7] : ['--panel', 280, innerWidth * 0.6];
      const pixels = Math.round(Math.min(Math.max(wanted, least), most));
      style.setProperty(name, `${pixels}px`);
      try { localStorage.setItem(SIZE + name, String(pixels)); } catch { /* storage is blocked */ }
    };
    for (const name of ['--sheet', '--panel']) {
      let saved = null;
      try { saved = Number(localStorage.getItem(SIZE + name)); } catch { /* storage is blocked */ }
      if (saved > 0) style.setProperty(name, `${saved}px`);
    }
    grip.addEventListener('pointerdown', (event) => { event.preventDefault(); grip.setPointerCapture(event.pointerId); });
    grip.addEventListener('pointermove', (event) => {
      if (!grip.hasPointerCapture(event.pointerId)) return;
      const box = $('panel').getBoundingClientRect();
      set(narrow() ? box.bottom - event.clientY : box.right - event.clientX);
    });
    grip.addEventListener('keydown', (event) => {
      const step = { ArrowLeft: 24, ArrowUp: 24, ArrowRight: -24, ArrowDown: -24 }[event.key];
      if (!step) return;
      set(size() + step);
      event.preventDefault();
      event.stopPropagation();
    });
  }

  show(name) {
    const before = this.shown;
    this.shown = name;
    if (name !== 'why') this.app.why.clear();
    if (name === 'tree' || before === 'tree') this.app.sendLayers(); // the states of the nodes are sent while they are shown
    for (const [other] of TABS) {
      $(`tab-${other}`).hidden = other !== name;
      $(`show-${other}`).setAttribute('aria-selected', String(other === name));
      $(`show-${other}`).tabIndex = other === name ? 0 : -1;
    }
    if (name === 'parameters') this.app.parameters.load();
    this.app.changed();
  }

  buildRobot() {
    const { theme, why } = this.app, chart = (label) => el('canvas', { className: 'chart', role: 'img', 'aria-label': label, title: 'Click: why this command' });
    this.numbers = el('div', { className: 'numbers' });
    const canvases = [chart('Speed over time'), chart('Turning over time'), chart('Clearance over time'), chart('Steering angle over time')], picked = (time) => why.command(time);
    this.charts = [
      new Chart(canvases[0], theme, 'm/s', [['speed', 'chart1', 2], ['command', 'chart2', 4, true]], picked),
      new Chart(canvases[1], theme, 'rad/s', [['turning', 'chart1', 3], ['command', 'chart2', 5, true]], picked),
      new Chart(canvases[2], theme, 'm', [['clearance', 'chart3', 1]], picked),
      new Chart(canvases[3], theme, 'rad', [['steering angle', 'chart1', 7]], picked),
    ];
    canvases[3].hidden = true; // only a car or a tricycle steers
    this.events = el('ul', { className: 'list events', id: 'events' });
    $('tab-robot').append(this.numbers, el('h2', {}, 'Over time'), ...canvases,
      el('div', { className: 'row wrap' },
        el('button', { type: 'button', className: 'outline', id: 'why-command', onclick: () => why.command(null) }, 'Why this command?'),
        el('button', { type: 'button', className: 'outline', id: 'clear', onclick: () => this.app.act({ type: 'clear_costmaps' }) }, 'Clear costmaps')),
      el('h2', {}, 'Events'), this.events);
  }

  buildGoals() {
    const app = this.app;
    this.queue = el('ul', { className: 'list', id: 'queue' });
    this.ended = el('ul', { className: 'list', id: 'ended' });
    this.loop = el('input', { type: 'checkbox', id: 'loop', onchange: () => this.setQueue(app.store.main.goals.waiting) });
    this.places = el('select', { id: 'places', 'aria-label': 'Place', onchange: (e) => {
      const pose = app.store.world.places[e.target.value];
      if (pose) app.act({ type: 'queue', goals: [...app.store.main.goals.waiting, pose], loop: this.loop.checked });
      e.target.value = '';
    } });
    this.tasks = el('select', { id: 'tasks', 'aria-label': 'Task', onchange: (e) => {
      if (e.target.value) app.act({ type: 'step_now', step: JSON.parse(e.target.value) });
      e.target.value = '';
    } });
    $('tab-goals').append(
      el('h2', {}, 'Goal and queue'), this.queue,
      el('div', { className: 'row wrap' },
        el('label', { className: 'row' }, this.loop, 'repeat the queue'),
        el('button', { type: 'button', className: 'outline', id: 'cancel', onclick: () => app.act({ type: 'cancel' }) }, 'Cancel all')),
      el('div', { className: 'row wrap' }, this.places,
        el('button', { type: 'button', className: 'outline', onclick: () => app.save.goals('places') }, 'Save as places'),
        el('button', { type: 'button', className: 'outline', onclick: () => app.save.goals('tour') }, 'Save as tour')),
      el('div', { className: 'row wrap' }, this.tasks),
      el('h2', {}, 'Ended goals'), this.ended);
  }

  setQueue(goals) { this.app.act({ type: 'queue', goals: goals.map((pose) => [...pose]), loop: this.loop.checked }); }

  world(world) {
    this.places.replaceChildren(el('option', { value: '' }, 'Add a place …'), ...Object.keys(world.places).map((name) => el('option', { value: name }, name)));
    const tasks = [...world.docks.map((dock) => [`Dock at ${dock}`, { dock }]), ...(world.docks.length ? [['Undock', { undock: true }]] : []), ['Cover the whole map', { cover: 'all' }]];
    this.tasks.replaceChildren(el('option', { value: '' }, 'Begin a task now …'), ...tasks.map(([label, step]) => el('option', { value: JSON.stringify(step) }, label)));
    this.tasks.disabled = this.app.readOnly;
    this.places.hidden = !Object.keys(world.places).length;
  }

  /** The panel is about the other robot now. */
  chosen() {
    for (const part of [this.numbers, this.events, this.queue, this.ended]) part.refreshKey = null;
    if (this.shown === 'parameters') this.app.parameters.load();
  }

  update(side, clock) {
    if (this.shown === 'robot') this.updateRobot(side, clock);
    if (this.shown === 'goals') this.updateGoals(side.goals);
    if (this.shown === 'graph') this.app.graph.update();
    $('show-tree').hidden = !side.behavior_tree; // move_base has none
    if (this.shown === 'tree') { if (side.behavior_tree) this.app.tree.update(side); else this.show('robot'); }
  }

  updateRobot(side, clock) {
    const last = side.samples.at(-1), clearance = last?.[1];
    const values = [
      ['speed', fixed(side.velocity[0], 2), 'm/s'], ['turning', fixed(side.velocity[2], 2), 'rad/s'], ['clearance', fixed(clearance, 2), 'm'],
      ['speed command', fixed(side.command[0], 2), 'm/s'], ['turn command', fixed(side.command[2], 2), 'rad/s'], ['driven', fixed(side.length, 1), 'm'],
      ['x', fixed(side.pose[0], 2), 'm'], ['y', fixed(side.pose[1], 2), 'm'], ['heading', fixed(side.pose[2] * 180 / Math.PI, 0), '°'], ['collisions', String(side.collisions), ''],
    ];
    const steers = side.steering !== undefined;
    if (steers) values.splice(6, 0, ['steering', fixed(side.steering, 2), 'rad']);
    this.charts[3].canvas.hidden = !steers;
    refresh(this.numbers, JSON.stringify(values), () => values.map(([label, value, unit]) => el('div', { className: 'number' }, el('span', {}, label), el('b', {}, value), ' ', el('i', {}, unit))));
    for (const chart of this.charts) chart.draw(side.samples, clock);
    const events = side.events.filter((event) => event[1] <= side.t + 1e-6);
    refresh(this.events, `${side.restarts} ${events.at(-1)?.[0]} ${events.length}`, () => grouped(events).slice(-60).sort((a, b) => b.time - a.time).map((row) => el('li', {},
      el('time', {}, `${row.time.toFixed(1)} s`), el('span', { className: EVENTS[row.kind] ?? '' }, row.text),
      row.count > 1 ? el('span', { className: 'chip', title: `${row.count} times since ${row.since.toFixed(1)} s` }, `${row.count}×`) : null)));
  }

  updateGoals(goals) {
    if (document.activeElement !== this.loop) this.loop.checked = goals.loop;
    refresh(this.queue, JSON.stringify([goals.under_way, goals.waiting, nextNumber(goals)]), () => {
      const rows = goals.under_way.map((goal) => el('li', {}, el('span', {}, `▶ goal ${goal.number}: ${poseText(goal.pose)}`),
        button('why', 'What happened to this goal', () => this.app.why.goal(goal.number)), button('copy', 'Copy x,y,yaw', () => copy(poseText(goal.pose)))));
      const move = (from, to) => { const list = [...goals.waiting]; list.splice(to, 0, ...list.splice(from, 1)); this.setQueue(list); };
      goals.waiting.forEach((pose, i) => rows.push(el('li', { draggable: true,
        ondragstart: (e) => e.dataTransfer.setData('text/plain', String(i)), ondragover: (e) => e.preventDefault(),
        ondrop: (e) => { e.preventDefault(); move(Number(e.dataTransfer.getData('text/plain')), i); } },
      el('span', {}, `goal ${nextNumber(goals) + i}: ${poseText(pose)}`),
      button('up', 'Earlier', () => move(i, i - 1), { disabled: i === 0 }), button('down', 'Later', () => move(i, i + 1), { disabled: i === goals.waiting.length - 1 }),
      button('copy', 'Copy x,y,yaw', () => copy(poseText(pose))), button('close', 'Remove', () => this.setQueue(goals.waiting.filter((_, k) => k !== i))))));
      return rows.length ? rows : [el('li', { className: 'empty' }, el('span', {}, 'No goal. Choose the flag and press on the map, drag for the heading; with Shift it joins the queue.'))];
    });
    refresh(this.ended, JSON.stringify(goals.ended), () => (goals.ended.length ? [...goals.ended].reverse().map((goal) => el('li', {},
      el('span', {}, `goal ${goal.number} `, el('span', { className: `chip ${STATES[goal.state] ?? ''}` }, goal.state), ` ${goal.time.toFixed(1)} s`),
      button('why', 'What happened to this goal', () => this.app.why.goal(goal.number)))) : [el('li', { className: 'empty' }, el('span', {}, 'None yet.'))]));
  }
}

/** Events in rows: what repeats, apart from its numbers, while nothing else happens, is one row with the latest text. */
export function grouped(events) {
  const rows = [];
  let open = new Map(); // the rows that go on
  for (const [, time, kind, text] of events) {
    const key = `${kind} ${text.replace(/[\d.]+/g, '#')}`, row = open.get(key);
    if (row) { Object.assign(row, { time, text: text || kind, count: row.count + 1 }); continue; }
    if (!ROUTINE.has(kind)) open = new Map();
    open.set(key, { time, since: time, kind, text: text || kind, count: 1 });
    rows.push(open.get(key));
  }
  return rows;
}

/** The dialog that asks for a name and saves. */
export class Save {
  constructor(app) { this.app = app; }

  open(what, title, extra = {}) {
    const dialog = $('save'), { world } = this.app.store;
    if (!world?.save_to) { toast('Nothing can be saved: start navstack live with --save-to DIR.', 'warning'); return; }
    const name = el('input', { type: 'text', id: 'save-name', value: what === 'parameters' ? 'params' : what === 'run' ? 'run' : 'my_' + what, pattern: '[A-Za-z0-9_][A-Za-z0-9_. \\-]*', required: true });
    const own = what === 'parameters' ? el('input', { type: 'checkbox', id: 'in-place', onchange: () => { name.disabled = own.checked; } }) : null;
    const options = () => (own ? { in_place: own.checked } : {});
    const form = el('form', { method: 'dialog', onsubmit: async () => {
      try { toast((await this.app.connection.request(this.app.about({ type: 'save', what, name: name.value, ...extra, ...options() }))).text); } catch (error) { toast(error.message, 'error'); }
    } }, el('h1', {}, title), el('p', {}, `Folder: ${world.save_to}`), el('div', { className: 'row' }, el('label', { htmlFor: 'save-name' }, 'Name'), name),
    own && el('p', {}, el('label', { className: 'row' }, own, 'into my own files in this folder, with their layout and comments')),
    el('p', { className: 'row' }, el('button', { className: 'primary', id: 'save-do' }, 'Save'), el('button', { type: 'button', className: 'outline', onclick: () => dialog.close() }, 'Cancel')));
    dialog.replaceChildren(form);
    dialog.showModal();
    name.select();
  }

  goals(what) {
    const { goals } = this.app.store.main, poses = [...goals.ended.map((g) => g.pose), ...goals.under_way.map((g) => g.pose), ...goals.waiting];
    if (!poses.length) { toast('There are no goals to save.', 'warning'); return; }
    this.open(what, what === 'tour' ? 'Save the goals as a tour' : 'Save the goals as places', { places: Object.fromEntries(poses.map((pose, i) => [`place_${i + 1}`, [...pose]])) });
  }
}
