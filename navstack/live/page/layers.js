// Which layers are shown, how opaque, and in which colors; kept in the browser.
import { COSTMAPS } from './colors.js';
import { el } from './dom.js';

/** Elements that explain the colors of costs. */
export function legend(scheme) {
  const table = COSTMAPS[scheme], ramp = el('canvas', { width: 252, height: 1, className: 'ramp' }), context = ramp.getContext('2d');
  const css = (cost) => { const v = table[cost]; return `rgb(${v & 255} ${v >> 8 & 255} ${v >> 16 & 255})`; };
  for (let cost = 1; cost < 253; cost++) { context.fillStyle = css(cost); context.fillRect(cost - 1, 0, 1, 1); }
  const swatch = (cost, label) => { const box = el('i', { className: 'swatch' }); box.style.background = css(cost); return el('span', {}, box, label); };
  return [el('span', {}, '1', ramp, '252'), swatch(253, 'inscribed 253'), swatch(254, 'lethal 254'), swatch(255, 'unknown')];
}

const LAYERS = [
  ['map', 'Map', true, 1], ['global', 'Global costmap', false, 0.6], ['local', 'Local costmap', true, 0.75], ['scan', 'Laser scans', true, 1],
  ['footprint', 'Robot (true footprint)', true, 1], ['padded', 'Padded footprint', true, 1], ['plan', 'Plan', true, 1], ['former', 'Previous plans', false, 1], ['trajectory', 'Chosen trajectory', true, 1],
  ['trajectories', 'Trajectories by score', false, 0.8], ['potential', 'Potential', false, 0.6], ['goals', 'Goals', true, 1], ['trail', 'Driven path', true, 0.9],
  ['shapes', 'Obstacles', true, 1], ['people', 'People and doors', true, 1],
  ['graph', 'Route graph', true, 1],
  ['camera', 'What the robot sees', false, 1],
];
const SERVER = ['global', 'local', 'scan', 'trajectories', 'potential', 'camera'];
const KEY = 'navstack-live-layers';

export class Layers {
  constructor(changed) {
    this.changed = changed;
    this.scheme = 'rviz';
    this.items = new Map(LAYERS.map(([name, label, on, opacity]) => [name, { name, label, on, opacity }]));
    try {
      const saved = JSON.parse(localStorage.getItem(KEY) ?? '{}');
      if (saved.scheme === 'cividis') this.scheme = 'cividis';
      for (const [name, values] of Object.entries(saved.items ?? {})) if (this.items.has(name)) Object.assign(this.items.get(name), { on: !!values.on, opacity: Number(values.opacity) || 0.1 });
    } catch { /* storage is blocked or damaged: defaults */ }
  }

  get(name) { return this.items.get(name); }

  /** Layers that the server has to send. */
  wanted() { return SERVER.filter((name) => this.get(name).on || name === 'global'); } // its costs are shown under the pointer

  store() {
    try { localStorage.setItem(KEY, JSON.stringify({ scheme: this.scheme, items: Object.fromEntries(this.items) })); } catch { /* blocked */ }
    this.changed();
  }

  toggle(name, on) {
    this.get(name).on = on;
    const box = document.getElementById(`layer-${name}`);
    if (box) box.checked = on;
    this.store();
  }

  build(section) {
    const rows = [...this.items.values()].map((layer) => el('div', { className: 'layer' },
      el('input', { type: 'checkbox', id: `layer-${layer.name}`, checked: layer.on, onchange: (e) => this.toggle(layer.name, e.target.checked) }),
      el('label', { htmlFor: `layer-${layer.name}` }, layer.label),
      el('input', { type: 'range', min: 0.1, max: 1, step: 0.05, value: layer.opacity, 'aria-label': `${layer.label}: opacity`, title: 'Opacity',
        oninput: (e) => { layer.opacity = Number(e.target.value); this.store(); } })));
    section.replaceChildren(
      el('h2', {}, 'Layers and opacity'), ...rows,
      el('h2', {}, 'Colors of costs and scores'),
      el('select', { id: 'scheme', 'aria-label': 'Colors of costs and scores', onchange: (e) => { this.scheme = e.target.value; this.store(); } },
        el('option', { value: 'rviz', selected: this.scheme === 'rviz' }, 'As in RViz'),
        el('option', { value: 'cividis', selected: this.scheme === 'cividis' }, 'For color-blind people (cividis)')),
      el('h2', {}, 'Map'), el('div', { className: 'row wrap', id: 'map-actions' }));
  }
}
