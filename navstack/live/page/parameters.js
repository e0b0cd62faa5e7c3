// Every parameter, by part, with its documentation; changes take effect in the next control cycle.
import { $, button, el, refresh, toast } from './dom.js';

export class Parameters {
  constructor(app) {
    this.app = app;
    this.list = null; // not known yet
    this.filter = '';
    this.open = new Set();
    this.search = el('input', { type: 'search', id: 'parameter-search', placeholder: 'Search: inflation, max_vel …', 'aria-label': 'Search parameters', oninput: (e) => { this.filter = e.target.value.trim().toLowerCase(); this.show(true); } });
    this.fixed = el('input', { type: 'checkbox', id: 'show-fixed', onchange: () => this.show(true) });
    this.sets = el('select', { id: 'sets', 'aria-label': 'Parameter set', onchange: (e) => { if (e.target.value) this.set({ params: e.target.value, values: {} }); e.target.value = ''; } });
    this.body = el('div', { id: 'parameter-list' });
    $('tab-parameters').append(
      el('div', { className: 'row' }, this.search),
      el('div', { className: 'row wrap' }, el('label', { className: 'row' }, this.fixed, 'also fixed ones'), this.sets),
      el('div', { className: 'row wrap' },
        el('button', { type: 'button', className: 'outline', id: 'diff', onclick: () => this.difference() }, 'Show changes'),
        el('button', { type: 'button', className: 'outline', id: 'save-parameters', onclick: () => app.save.open('parameters', 'Save the changed parameters') }, 'Save')),
      el('p', {}), this.body);
  }

  /** Fills the list of sets to switch to. */
  showSets({ packaged, named, folder }) {
    const group = (label, names) => (names.length ? [el('optgroup', { label }, ...names.map((name) => el('option', { value: name }, name)))] : []);
    this.sets.replaceChildren(el('option', { value: '' }, 'Switch to …'), ...group('Your files', [...named, ...folder]), ...group('Packaged', packaged));
  }

  async load() {
    if (!this.app.store.world) { this.show(true); return; } // the server prepares the robot
    this.app.connection.request({ type: 'sets' }).then((answer) => this.showSets(answer.data), () => {});
    try { this.take((await this.app.connection.request(this.app.about({ type: 'parameters' }))).data); } catch (error) { toast(error.message, 'error'); }
  }

  take(list, keep = false) { this.list = list; this.show(!keep); }

  async set(change) {
    try {
      this.take((await this.app.connection.request(this.app.about({ type: 'set', ...change }))).data);
    } catch (error) {
      toast(error.message, 'error');
      this.load();
    }
  }

  async difference() {
    try {
      const { text } = await this.app.connection.request(this.app.about({ type: 'difference' }));
      $('tab-why').replaceChildren(el('h2', {}, 'Changes to your files'), el('pre', { id: 'answer', tabindex: 0 }, text));
      this.app.panel.show('why');
    } catch (error) { toast(error.message, 'warning'); }
  }

  show(force) {
    if (!this.list) { refresh(this.body, 'unknown', () => [el('p', { className: 'empty' }, 'The parameters appear here when the robot is ready.')]); return; }
    const shown = this.list.filter((p) => (p.live || this.fixed.checked) && (!this.filter || p.name.toLowerCase().includes(this.filter) || p.meaning.toLowerCase().includes(this.filter)));
    const parts = new Map();
    for (const p of shown) parts.set(p.part, [...(parts.get(p.part) ?? []), p]);
    const focused = document.activeElement?.id;
    if (force) this.body.refreshKey = null;
    refresh(this.body, JSON.stringify(shown), () => {
      if (!shown.length) return [el('p', { className: 'empty' }, this.filter ? `No parameter matches “${this.filter}”.` : 'No parameter can be changed while the robot drives.')];
      return [...parts].map(([part, list]) => {
        const changed = list.filter((p) => p.changed).length;
        return el('details', { open: this.filter !== '' || this.open.has(part), ontoggle: (e) => (e.target.open ? this.open.add(part) : this.open.delete(part)) },
          el('summary', {}, part, changed ? el('span', { className: 'chip' }, ` ${changed} changed`) : null),
          el('div', {}, ...list.map((p) => this.row(p))));
      });
    });
    if (focused?.startsWith('p-')) $(focused)?.focus();
  }

  row(p) {
    const id = `p-${p.name}`;
    return el('div', { className: `parameter${p.changed ? ' changed' : ''}`, 'data-name': p.name },
      el('div', { className: 'name' }, el('label', { htmlFor: id }, p.key), p.changed ? el('b', { title: 'changed' }, '●') : null, el('span', { className: 'grow' }),
        p.changed ? button('undo', `Back to ${p.initial}`, () => this.set({ values: { [p.name]: p.initial } })) : null),
      el('small', {}, p.meaning, p.default !== null && p.default !== '' ? ` (default ${p.default}${p.unit ? ` ${p.unit}` : ''}${this.range(p)})` : this.range(p)),
      el('div', { className: 'control' }, ...this.control(p, id)));
  }

  range(p) {
    const low = p.bounds.ge ?? p.bounds.gt, high = p.bounds.le ?? p.bounds.lt;
    if (low === undefined && high === undefined) return '';
    if (high === undefined) return `; ${p.bounds.ge !== undefined ? 'at least' : 'above'} ${low}`;
    return low === undefined ? `; at most ${high}` : `; ${low} to ${high}`;
  }

  control(p, id) {
    const disabled = !p.live || this.app.readOnly, send = (value) => this.set({ values: { [p.name]: value } });
    if (p.type === 'bool') return [el('input', { type: 'checkbox', id, checked: p.value, disabled, onchange: (e) => send(e.target.checked) })];
    if (p.choices.length) return [el('select', { id, disabled, onchange: (e) => send(e.target.value) }, ...p.choices.map((c) => el('option', { value: c, selected: c === p.value }, c)))];
    if (typeof p.value !== 'number') return [el('input', { type: 'text', id, value: p.value ?? '', disabled: disabled || p.type === 'other', onchange: (e) => send(e.target.value) }), el('span', { className: 'unit' }, p.unit)];
    const step = p.type === 'int' ? 1 : Math.max(0.001, 10 ** Math.floor(Math.log10(Math.max(Math.abs(p.value), Math.abs(p.initial ?? 0), 0.1)) - 1));
    const span = Math.max(Math.abs(p.value), Math.abs(p.initial ?? 0), Math.abs(p.default || 0), 10 * step) * 2;
    const low = Math.max(p.bounds.ge ?? p.bounds.gt ?? -Infinity, p.value < 0 || p.initial < 0 ? -span : 0), high = Math.min(p.bounds.le ?? p.bounds.lt ?? Infinity, span);
    const number = el('input', { type: 'number', id, value: p.value, step: 'any', disabled, onchange: (e) => e.target.value !== '' && send(Number(e.target.value)) });
    const slider = el('input', { type: 'range', 'aria-label': `${p.key}: slider`, min: low, max: high, step, value: p.value, disabled,
      oninput: (e) => { number.value = e.target.value; }, onchange: (e) => send(Number(e.target.value)) });
    return [slider, number, el('span', { className: 'unit' }, p.unit)];
  }
}
