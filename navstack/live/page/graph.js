// The route graph: drawn on the map, edited with the tool Route graph, checked, saved, and driven along.
import { $, el, refresh, toast } from './dom.js';

const NEAR_PX = 12, TOUCH_PX = 22;
const MODES = [['select', 'Select, move'], ['node', 'Add nodes'], ['connect', 'Connect']];
const HINTS = {
  select: 'Click a node or an edge; drag a node to move it, drag the map to pan.',
  node: 'Click the map: a node there.',
  connect: 'Drag from node to node, or click one after the other.',
};
const ATTRIBUTES = [
  ['speed_limit', 'Speed limit', 'number', 'A share of the full speed up to 1, or percent'], ['penalty', 'Penalty', 'number', 'Added by PenaltyScorer'],
  ['class', 'Class', 'text', 'For SemanticScorer'], ['cost', 'Cost', 'number', 'Of the file; scorers replace it if overridable'],
];

export class Graph {
  constructor(app) {
    this.app = app;
    this.mode = 'select';
    this.reset();
    this.asking = false;
    this.build();
  }

  reset() { Object.assign(this, { data: null, xy: new Map(), pairs: new Map(), node: null, edge: null, from: null, findings: null, summary: '', stale: false }); }

  get shown() { return this.app.layers.get('graph').on && this.data; }

  build() {
    const outline = (id, label, onclick, title = '') => el('button', { type: 'button', className: 'outline edits', id, title, onclick }, label);
    this.modes = MODES.map(([name, label]) => el('button', { type: 'button', className: 'outline edits', id: `graph-${name}`, 'aria-pressed': 'false', onclick: () => this.setMode(name) }, label));
    this.bothWays = el('input', { type: 'checkbox', id: 'graph-both', checked: true });
    this.counts = el('p', { className: 'empty', id: 'graph-counts' });
    this.driving = el('p', { id: 'graph-driving', hidden: true });
    this.selection = el('div', { id: 'graph-selection' });
    this.list = el('ul', { className: 'list', id: 'graph-findings' });
    this.name = el('input', { type: 'text', id: 'graph-name', 'aria-label': 'Name of the file', pattern: '[A-Za-z0-9_][A-Za-z0-9_. \\-]*', required: true });
    $('tab-graph').append(
      el('h2', {}, 'Route graph'), this.counts, this.driving,
      el('div', { className: 'row wrap', role: 'group', 'aria-label': 'What the pointer does' }, ...this.modes),
      el('label', { className: 'row' }, this.bothWays, 'connect both ways'),
      el('div', { className: 'row wrap' }, outline('graph-undo', 'Undo', () => this.edit({ type: 'graph_undo' })), outline('graph-from-map', 'Graph from map', () => this.fromMap(), 'Replaces the graph by one of the free space; Undo brings it back'),
        el('button', { type: 'button', className: 'outline', id: 'graph-check', onclick: () => this.check() }, 'Check')),
      this.selection, this.list,
      el('h2', {}, 'Save'), this.folder = el('p', { className: 'empty' }),
      el('form', { className: 'row', onsubmit: (e) => { e.preventDefault(); this.save(); } }, this.name, '.geojson', el('button', { className: 'outline edits', id: 'graph-save' }, 'Save')));
    this.setMode('select');
  }

  setMode(name) {
    this.mode = name;
    this.from = null;
    MODES.forEach(([other], i) => this.modes[i].setAttribute('aria-pressed', String(other === name)));
    if (this.app.tools && this.app.tools.tool !== 'graph') this.app.tools.choose('graph');
    this.app.changed();
  }

  hint() { return this.mode === 'connect' && this.from !== null ? `From node ${this.from}: click the node that the edge leads to.` : HINTS[this.mode]; }

  // --- data ---------------------------------------------------------------------------------------------------------

  world(world) {
    this.reset();
    this.name.value = '';
    if (world.graph) this.take(world.graph);
    for (const item of $('tab-graph').querySelectorAll('.edits')) item.disabled = this.app.readOnly;
    this.update();
  }

  /** Every frame has the version of the graph: another page may have changed it. */
  async seen(version) {
    if (version === (this.data?.version ?? 0) || this.asking) return;
    this.asking = true;
    try { this.take((await this.app.connection.request({ type: 'graph' })).data); } catch { /* the next frame asks again */ }
    this.asking = false;
  }

  take(data) {
    if (this.data && data.version < this.data.version) return;
    this.stale = this.findings !== null && data.version !== this.data?.version;
    this.data = data;
    this.xy = new Map(data.nodes.map(([id, x, y]) => [id, [x, y]]));
    this.pairs = new Map(data.edges.map(([id, a, b]) => [`${a} ${b}`, id]));
    this.edges = new Map(data.edges.map((edge) => [edge[0], edge]));
    if (!this.xy.has(this.node)) this.node = null;
    if (!this.xy.has(this.from)) this.from = null;
    if (!this.edges.has(this.edge)) this.edge = null;
    if (!this.name.value) this.name.value = `${data.name}_edited`.replace(/[^A-Za-z0-9_. -]/g, '_');
    this.update();
  }

  async edit(message) {
    if (this.app.readOnly) { toast('This page cannot change the graph.', 'warning'); return null; }
    const answer = await this.app.act(message);
    if (answer?.data) this.take(answer.data);
    return answer;
  }

  async fromMap() { const answer = await this.edit({ type: 'graph_from_map' }); if (answer) toast(answer.text); }

  async check() {
    const answer = await this.app.act({ type: 'graph_check' });
    if (!answer) return;
    [this.findings, this.summary, this.stale] = [answer.data, answer.text, false];
    this.update();
  }

  async save() { const answer = await this.app.act({ type: 'graph_save', name: this.name.value }); if (answer) toast(answer.text); }

  // --- pointers -----------------------------------------------------------------------------------------------------

  near(touch) { return (touch ? TOUCH_PX : NEAR_PX) / this.app.camera.scale; }

  nodeAt(x, y, touch = false) {
    let best = this.near(touch), found = null;
    if (this.shown) for (const [id, [u, v]] of this.xy) { const d = Math.hypot(u - x, v - y); if (d < best) [best, found] = [d, id]; }
    return found;
  }

  /** The edge nearest to a point. Of two directions on one line the one to the right of which the point is: traffic keeps right. */
  edgeAt(x, y, touch = false) {
    let best = this.near(touch), found = null;
    if (!this.shown) return null;
    for (const [id, a, b] of this.data.edges) {
      const [ax, ay] = this.xy.get(a), [bx, by] = this.xy.get(b), dx = bx - ax, dy = by - ay, squared = dx * dx + dy * dy || 1e-9;
      const t = Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / squared)), left = dx * (y - ay) - dy * (x - ax) > 0;
      const d = Math.hypot(ax + t * dx - x, ay + t * dy - y) + (left ? 1e-6 : 0);
      if (d < best) [best, found] = [d, id];
    }
    return found;
  }

  /** Whether a press begins a gesture of the editor, or pans. */
  takes(x, y, touch) { return this.mode === 'node' || this.nodeAt(x, y, touch) !== null; }

  click(x, y, touch) {
    this.node = this.nodeAt(x, y, touch);
    this.edge = this.node === null ? this.edgeAt(x, y, touch) : null;
    this.update();
  }

  drop(drag) {
    const { x, y, x2, y2, moved, touch } = drag, start = this.nodeAt(x, y, touch), round = (v) => Math.round(v * 1000) / 1000;
    if (this.mode === 'node' && !moved) { if (start === null) this.edit({ type: 'graph_add_node', x: round(x), y: round(y) }); else this.click(x, y, touch); return; }
    if (this.mode === 'connect') {
      const end = moved ? this.nodeAt(x2, y2, touch) : start;
      if (moved) { this.from = null; if (end !== null && end !== start) this.connect(start, end); } else if (this.from === null || this.from === end) this.from = this.from === end ? null : end;
      else { this.connect(this.from, end); this.from = null; }
      this.update();
      return;
    }
    if (start === null) return;
    if (!moved) { this.click(x, y, touch); return; }
    this.xy.set(start, [x2, y2]); // at once; the server's answer follows, or an error
    const { data } = this;
    this.edit({ type: 'graph_move_node', node: start, x: round(x2), y: round(y2) }).then((answer) => { if (!answer) this.take(data); });
  }

  connect(start, end) { return this.edit({ type: 'graph_connect', start, end, both_ways: this.bothWays.checked }); }

  remove() {
    if (this.node === null && this.edge === null) return;
    this.edit({ type: 'graph_delete', nodes: this.node === null ? [] : [this.node], edges: this.edge === null ? [] : [this.edge] });
  }

  drive() { this.app.act({ type: 'graph_drive', node: this.node }).then((answer) => answer && this.app.store.main?.paused && toast('Press play: the robot drives along the route.')); }

  // --- panel --------------------------------------------------------------------------------------------------------

  update() {
    const { data } = this, side = this.app.store.main, route = side?.route;
    this.counts.textContent = data && (data.nodes.length || data.edges.length) ? `${data.nodes.length} nodes, ${data.edges.length} edges` : 'No graph yet: add nodes and connect them, or make one from the map.';
    const folder = data ? data.folder : this.app.store.world?.save_to; // no graph yet: as --save-to says
    this.folder.textContent = folder ? `Folder: ${folder}` : 'Nothing can be saved: start navstack live with --graph FILE or --save-to DIR.';
    $('graph-undo').disabled = this.app.readOnly || !data?.can_undo;
    this.driving.hidden = !route;
    if (route) {
      const edge = this.edges?.get(route.edge);
      this.driving.textContent = route.edge === null ? `Driving to the route; next node ${route.next ?? '–'}` : `On edge ${route.edge}${edge ? ` (node ${edge[1]} to ${edge[2]})` : ''}, next node ${route.next ?? '–'}${route.rerouted ? `, rerouted ${route.rerouted}×` : ''}`;
    }
    refresh(this.selection, `${this.node} ${this.edge} ${JSON.stringify(this.edges?.get(this.edge) ?? this.xy.get(this.node))} ${this.app.readOnly}`, () => this.selected());
    refresh(this.list, `${this.summary} ${this.stale} ${JSON.stringify(this.findings)}`, () => this.found());
    this.app.changed();
  }

  selected() {
    const locked = this.app.readOnly, remove = el('button', { type: 'button', className: 'outline', id: 'graph-delete', disabled: locked, onclick: () => this.remove() }, 'Delete');
    if (this.node !== null) {
      const [x, y] = this.xy.get(this.node);
      return [el('h2', {}, `Node ${this.node}`), el('p', {}, `${x.toFixed(2)}, ${y.toFixed(2)} m`), el('div', { className: 'row wrap' },
        el('button', { type: 'button', className: 'outline', id: 'graph-drive', disabled: locked, onclick: () => this.drive() }, 'Drive here along the route'), remove)];
    }
    if (this.edge === null) return [];
    const [id, a, b, values] = this.edges.get(this.edge), back = this.pairs.get(`${b} ${a}`);
    const both = el('input', { type: 'checkbox', id: 'graph-set-both', checked: back !== undefined });
    const set = (name, value) => this.edit({ type: 'graph_set', edges: both.checked && back !== undefined ? [id, back] : [id], values: { [name]: value } }).then((answer) => { if (!answer) { this.selection.refreshKey = null; this.update(); } });
    const rows = ATTRIBUTES.map(([name, label, type, title]) => el('div', { className: 'attribute', title }, el('label', { htmlFor: `graph-${name}` }, label),
      el('input', { type, id: `graph-${name}`, step: 'any', value: values[name] ?? '', placeholder: 'none', disabled: locked,
        onchange: (e) => set(name, e.target.value === '' ? null : type === 'number' ? Number(e.target.value) : e.target.value) })));
    return [el('h2', {}, `Edge ${id}: node ${a} to ${b}`), ...rows,
      el('label', { className: 'row' }, el('input', { type: 'checkbox', id: 'graph-overridable', checked: values.overridable !== false, disabled: locked, onchange: (e) => set('overridable', e.target.checked) }), 'scorers may replace the cost'),
      back === undefined ? null : el('label', { className: 'row' }, both, `also for edge ${back}, the way back`),
      el('div', { className: 'row wrap' }, back === undefined ? null : el('button', { type: 'button', className: 'outline', id: 'graph-other', onclick: () => { this.edge = back; this.update(); } }, 'The way back'), remove)].filter((item) => item);
  }

  found() {
    if (this.findings === null) return [];
    const head = el('li', { className: 'empty' }, el('span', {}, `${this.summary}${this.stale ? ' (before the last change)' : ''}`));
    return [head, ...this.findings.map((item) => el('li', {}, el('button', { type: 'button', className: `finding ${item.severity === 'error' ? 'bad' : 'warn'}`, disabled: !item.at, title: 'Show the place', onclick: () => this.show(item) }, item.message)))];
  }

  show(finding) {
    const { camera } = this.app;
    [camera.x, camera.y] = finding.at;
    camera.scale = Math.max(camera.scale, 60);
    camera.fitted = this.app.follow = false;
    this.app.followButton();
    this.node = finding.nodes.find((id) => this.xy.has(id)) ?? null;
    this.edge = this.node === null ? finding.edges.find((id) => this.edges.has(id)) ?? null : null;
    this.update();
  }

  // --- map ----------------------------------------------------------------------------------------------------------

  /** Draws edges and nodes; one-way edges have an arrow, the route that is driven is wider. */
  draw(scene, side) {
    if (!this.data) return;
    const { theme } = this.app, { context: c, px } = scene, drag = this.app.tools.drag?.kind === 'graph' ? this.app.tools.drag : null;
    const moving = drag && this.mode === 'select' && drag.moved ? this.nodeAt(drag.x, drag.y, drag.touch) : null;
    const at = (id) => (id === moving ? [drag.x2, drag.y2] : this.xy.get(id)), onRoute = new Set(side?.route?.edges ?? []);
    const half = this.edge === null ? null : this.edge, editing = this.app.tools.tool === 'graph';
    const thin = Math.min(1.8, Math.max(0.8, this.app.camera.scale / 16)); // a whole map on a phone: the graph does not hide it
    c.save();
    c.globalAlpha *= editing ? 1 : 0.6;
    c.beginPath();
    for (const [, a, b] of this.data.edges) if (a < b || !this.pairs.has(`${b} ${a}`)) { c.moveTo(...at(a)); c.lineTo(...at(b)); }
    Object.assign(c, { strokeStyle: theme.accent, lineWidth: thin * px, lineCap: 'round' });
    c.stroke();
    for (const [id, a, b, values] of this.data.edges) {
      const p = at(a), q = at(b), oneWay = !this.pairs.has(`${b} ${a}`);
      if (onRoute.has(id)) scene.line([...p, ...q], theme.goal, 5);
      if (id === side?.route?.edge || id === half) scene.line([...p, ...q], id === half ? theme.trajectory : theme.robot, id === half ? 6 : 9);
      if (oneWay || id === half) this.head(c, p, q, px, id === half ? theme.trajectory : theme.accent);
      if (isClose(this.app.camera) && Object.keys(values).length && (oneWay || a < b)) scene.text(label(values), (p[0] + q[0]) / 2, (p[1] + q[1]) / 2 + 10 * px, theme.muted, 11);
    }
    const radius = Math.min(5, editing ? 5 : 2.8 * thin) * px;
    for (const [id] of this.xy) {
      const p = at(id), chosen = id === this.node || id === this.from;
      c.beginPath();
      c.arc(...p, chosen ? 1.6 * radius : radius, 0, 2 * Math.PI);
      Object.assign(c, { fillStyle: chosen ? theme.trajectory : theme.surface, strokeStyle: theme.accent, lineWidth: thin * px });
      c.fill();
      c.stroke();
      if (chosen) scene.text(String(id), p[0], p[1] + 18 * px, theme.text, 12);
    }
    c.restore();
    const pointer = this.app.tools.pointer;
    if (this.mode === 'connect' && drag?.moved) scene.line([...at(this.nodeAt(drag.x, drag.y, drag.touch)), drag.x2, drag.y2], theme.trajectory, 3, [6, 4]);
    else if (this.from !== null && pointer && this.app.tools.tool === 'graph') scene.line([...at(this.from), ...pointer], theme.trajectory, 2, [6, 4]);
  }

  head(c, [ax, ay], [bx, by], px, color) {
    const yaw = Math.atan2(by - ay, bx - ax), size = 9 * px;
    c.save();
    c.translate(ax + 0.6 * (bx - ax), ay + 0.6 * (by - ay));
    c.rotate(yaw);
    c.beginPath();
    c.moveTo(size, 0);
    c.lineTo(-0.6 * size, 0.7 * size);
    c.lineTo(-0.6 * size, -0.7 * size);
    c.closePath();
    c.fillStyle = color;
    c.fill();
    c.restore();
  }
}

const isClose = (camera) => camera.scale >= 45; // labels only where there is room
const label = (values) => Object.entries(values).map(([name, value]) => (name === 'overridable' ? 'fixed cost' : `${name.replace('_', ' ')} ${value}`)).join(', ');
