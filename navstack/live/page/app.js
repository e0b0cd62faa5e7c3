// Connects everything.
import { Camera } from './camera.js';
import { Theme } from './colors.js';
import { Connection } from './connection.js';
import { FirstPerson } from './first_person.js';
import { $, copy, el, poseText, refresh, setIcon, toast } from './dom.js';
import { Graph } from './graph.js';
import { helpText } from './help.js';
import { Layers, legend } from './layers.js';
import { Panel, Save } from './panel.js';
import { Parameters } from './parameters.js';
import { Scene } from './scene.js';
import { Store } from './store.js';
import { Teleop } from './teleop.js';
import { Timeline } from './timeline.js';
import { Tools } from './tools.js';
import { Tree } from './tree.js';
import { Versus } from './versus.js';
import { Why } from './why.js';

class App {
  constructor() {
    this.store = new Store();
    this.camera = new Camera();
    this.theme = new Theme(() => this.changed());
    this.layers = new Layers(() => { this.sendLayers(); this.legend(); this.changed(); });
    this.connection = new Connection({
      frame: (header, blobs) => this.frame(header, blobs),
      status: (kind, text) => this.status(kind, text),
      notice: (notice) => toast(notice.text, notice.severity),
      progress: (progress) => this.progress(progress),
      connected: () => { this.sendLayers(); },
    });
    this.scenes = [$('scene'), $('scene2')].map((canvas, view) => new Scene(canvas, this.store, this.camera, this.layers, this.theme, view));
    this.scene = this.scenes[0];
    this.versus = new Versus(this);
    this.why = new Why(this);
    this.save = new Save(this);
    this.teleop = new Teleop(this);
    for (const scene of this.scenes) scene.refit = () => this.fit();
    for (const scene of this.scenes) scene.graph = (where, side) => this.graph.draw(where, side);
    for (const scene of this.scenes) scene.fan = (where, side) => this.why.draw(where, side);
    this.graph = new Graph(this);
    this.tools = new Tools(this);
    this.timeline = new Timeline(this);
    this.firstPerson = new FirstPerson(this);
    this.parameters = new Parameters(this);
    this.tree = new Tree($('tab-tree'));
    this.panel = new Panel(this);
    this.layers.build($('tab-layers'));
    this.tools.buildActions();
    this.legend();
    this.follow = false;
    this.busy = null; // what the server does while nothing moves
    this.toast = toast;
    this.buttons();
    addEventListener('keydown', (event) => this.key(event));
    if (matchMedia('(max-width: 760px)').matches) this.togglePanel();
    this.connection.start();
    requestAnimationFrame((now) => this.loop(now));
  }

  get readOnly() { return !!(this.store.world?.read_only || this.store.world?.fixed); }

  frame(header, blobs) {
    this.store.frame(header, blobs, performance.now());
    if (header.type === 'world') {
      for (const scene of this.scenes) scene.loadMap();
      this.versus.world(header);
      this.teleop.world(header);
      $('title').textContent = header.name;
      document.title = `${header.name} – navstack live`;
      document.body.classList.toggle('read-only', this.readOnly);
      for (const name of ['goal', 'pose', 'disc', 'box', 'wall', 'person', 'delete', 'drive']) $(`tool-${name}`).disabled = this.readOnly;
      $('clear').disabled = this.readOnly;
      $('eye').hidden = !header.camera;
      for (const id of ['play', 'step', 'speed']) $(id).disabled = header.read_only;
      for (const id of ['restart', 'back', 'timeline']) $(id).disabled = header.read_only || !header.rewinds;
      $('fleet').hidden = !header.robots.length;
      $('robots').replaceChildren(...header.robots.map((name) => el('option', { value: name, selected: name === header.robot }, name)));
      this.panel.world(header);
      this.graph.world(header);
      this.progress(null);
      if (this.panel.shown === 'parameters') this.parameters.load();
    } else this.graph.seen(header.graph);
    this.changed();
  }

  /** What the server does while nothing moves; null or an empty text: nothing. */
  progress(progress) {
    const box = $('progress'), [text, bar, count] = box.children;
    this.busy = progress?.text || null;
    box.hidden = !this.busy;
    if (this.busy) {
      text.textContent = this.busy;
      if (progress.total) { bar.max = progress.total; bar.value = progress.done; } else bar.removeAttribute('value');
      count.textContent = `${progress.total ? `${progress.done} of ${progress.total}, ` : ''}${progress.seconds.toFixed(0)} s`;
    }
    this.changed();
  }

  status(kind, text) {
    if (kind !== 'good') this.progress(null);
    $('link').textContent = text;
    $('link').className = `chip ${kind}`;
    this.changed();
  }

  changed() { this.dirty = true; }

  loop(now) {
    const side = this.store.main;
    if (side?.moving) this.dirty = true;
    if (this.dirty || this.scenes.some((scene) => scene.needed)) {
      this.dirty = false;
      if (side?.pose && this.follow) { [this.camera.x, this.camera.y] = side.poseAt(now); this.camera.fitted = false; }
      for (const scene of this.scenes) { scene.needed = false; if (!scene.canvas.hidden) scene.draw(now); }
      this.texts(side, now);
    }
    requestAnimationFrame((time) => this.loop(time));
  }

  texts(side, now) {
    const set = (id, text) => { if ($(id).textContent !== text) $(id).textContent = text; };
    set('hint', this.tools.hint());
    $('hint').title = this.tools.hint();
    this.teleop.update();
    this.firstPerson.update(side);
    const bar = this.camera.bar();
    const [line, label] = $('scale').children, length = bar.meters >= 1 ? `${bar.meters} m` : `${Math.round(bar.meters * 100)} cm`;
    line.style.width = `${bar.pixels}px`;
    if (label.textContent !== length) label.textContent = length;
    if (!side?.pose) return;
    const clock = side.clockAt(now), point = this.tools.pointer;
    set('clock', `${clock.toFixed(1)} s`);
    set('factor', side.paused || side.done || this.busy ? '' : `${side.factor >= 10 ? side.factor.toFixed(0) : side.factor.toFixed(1)}×`);
    const state = this.busy ? 'busy' : side.seeking ? 'simulating' : side.by_hand ? 'by hand' : side.done ? 'done' : side.paused ? 'paused' : side.recovery || side.state.toLowerCase();
    set('state', state);
    set('where', point ? `${point[0].toFixed(2)}, ${point[1].toFixed(2)} m${this.tools.costText(side, ...point)}` : '');
    if (this.playing !== (side.paused || side.done)) {
      this.playing = side.paused || side.done;
      setIcon($('play'), this.playing ? 'play' : 'pause');
      $('play').setAttribute('aria-label', this.playing ? 'Continue' : 'Pause');
    }
    const speed = side.speed === null ? 'max' : String(side.speed);
    if ($('speed').value !== speed && document.activeElement !== $('speed')) {
      if (![...$('speed').options].some((option) => option.value === speed)) $('speed').append(el('option', { value: speed }, `${speed}×`));
      $('speed').value = speed;
    }
    this.timeline.update(side, clock);
    this.panel.update(side, clock);
    this.versus.update();
  }

  // --- actions ------------------------------------------------------------------------------------------------------

  /** A request about the robot that the panel is about. */
  about(message) { return { ...message, side: this.store.chosen }; }

  /** Marks an obstacle. */
  select(name) { for (const scene of this.scenes) scene.selected = name; }

  async act(message) {
    try {
      return await this.connection.request(message);
    } catch (error) {
      toast(error.message, 'error');
      return null;
    }
  }

  goal(pose, append) {
    const goals = this.store.main.goals;
    if (append && (goals.under_way.length || goals.waiting.length)) return this.act({ type: 'queue', goals: [...goals.waiting, pose], loop: goals.loop });
    return this.act({ type: 'goal', pose });
  }

  copyPose(pose) { copy(poseText(pose)); }

  sendLayers() {
    if (this.connection.open) this.connection.request({ type: 'layers', layers: [...this.layers.wanted(), ...(this.panel?.shown === 'tree' ? ['tree'] : [])], rate: 30 }).catch(() => {});
  }

  play() {
    const side = this.store.main;
    if (!side) return;
    if (side.done && !this.readOnly) this.act({ type: 'wait', duration: 60 }).then(() => side.paused && this.act({ type: 'pause', paused: false }));
    else this.act({ type: 'pause', paused: !side.paused });
  }

  back(seconds) { const side = this.store.main; if (side) this.timeline.seek(Math.max(0, side.t - seconds)); }

  togglePanel() {
    const hidden = document.body.classList.toggle('no-panel');
    $('sheet-button').setAttribute('aria-expanded', String(!hidden));
    this.changed();
  }

  /** Opens the panel at a tab. */
  showPanel(tab) {
    if (document.body.classList.contains('no-panel')) this.togglePanel();
    this.panel.show(tab);
  }

  help() { helpText($('help')); $('help').showModal(); }

  /** The colors of costs, below the map while a costmap is shown. */
  legend() {
    const shown = this.layers.get('local').on || this.layers.get('global').on;
    refresh($('legend'), `${shown} ${this.layers.scheme}`, () => (shown ? legend(this.layers.scheme) : []));
  }

  zoom(factor) { this.camera.zoom(factor); this.changed(); }

  /** Shows the whole map above what covers the bottom: the table of two robots, the pad on a phone. */
  fit() {
    if (!this.scene.extent) return;
    this.follow = false;
    const pad = this.teleop.on && matchMedia('(max-width: 760px)').matches ? 190 : 0;
    this.camera.fit(this.scene.extent, Math.max(pad, this.versus.below));
    this.followButton();
  }

  followButton() { $('follow').setAttribute('aria-pressed', String(this.follow)); this.changed(); }

  buttons() {
    const on = (id, action) => $(id).addEventListener('click', action);
    on('play', () => this.play());
    on('step', () => this.act({ type: 'step' }));
    on('back', () => this.back(5));
    on('restart', () => this.restart());
    on('help-button', () => this.help());
    on('sheet-button', () => this.togglePanel());
    on('zoom-in', () => this.zoom(1.4));
    on('zoom-out', () => this.zoom(1 / 1.4));
    on('fit', () => this.fit());
    on('follow', () => { this.follow = !this.follow; this.followButton(); });
    on('help', (event) => { if (event.target === $('help')) $('help').close(); });
    $('robots').addEventListener('change', (event) => this.showRobot(event.target.value));
    $('speed').addEventListener('change', (event) => this.act({ type: 'speed', factor: event.target.value === 'max' ? null : Number(event.target.value) }));
  }

  /** Shows another robot of the fleet; the page begins anew: its footprint, limits and layers are others. */
  async showRobot(name) { if (await this.act({ type: 'robot', name })) location.reload(); }

  /** A recorded run goes to its start; a session begins again. */
  restart() { return this.store.world?.fixed ? this.timeline.seek(0) : this.act({ type: 'restart' }); }

  key(event) {
    const typing = event.target.closest?.('input:not([type="checkbox"]):not([type="range"]), select, textarea, dialog');
    if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
    if (this.teleop.key(event)) { event.preventDefault(); return; }
    const onButton = event.target.closest?.('button, summary, input');
    const actions = {
      ' ': () => this.play(), n: () => this.act({ type: 'step' }), PageUp: () => this.back(5), Home: () => this.restart(), '+': () => this.zoom(1.25), '-': () => this.zoom(0.8),
      0: () => this.fit(), x: () => { if (this.versus.two) $('split').click(); }, f: () => { this.follow = !this.follow; this.followButton(); }, i: () => this.firstPerson.toggle(), '?': () => this.help(), s: () => this.save.open('scenario', 'Save the session as a scenario'),
      Escape: () => { this.graph.from = null; this.tools.cross = this.tools.measured = null; this.why.clear(); if (this.teleop.on) this.tools.choose('drive'); this.tools.choose('why'); },
    };
    if ((onButton && (event.key === ' ' || event.key === 'Enter')) || (event.target.type === 'range' && /^(Arrow|Page|Home|End)/.test(event.key))) return;
    if (this.tools.key(event)) event.preventDefault();
    else if (actions[event.key]) { event.preventDefault(); actions[event.key](); }
  }
}

window.navstack = new App();
