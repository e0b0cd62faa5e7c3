// The behavior tree of a Nav2 robot: its nodes, which of them run, and how the others ended.
import { el, refresh } from './dom.js';

const STATES = [['never', 'never ran'], ['running', 'running'], ['good', 'succeeded'], ['bad', 'failed'], ['skipped', 'skipped'], ['halted', 'halted']];

export class Tree {
  constructor(section) {
    this.head = el('p', { className: 'tree-head' });
    this.all = el('input', { type: 'checkbox', checked: true, onchange: () => this.list.classList.toggle('ran', !this.all.checked) });
    this.list = el('ul', { className: 'tree', 'aria-label': 'Nodes of the behavior tree' });
    section.append(this.head, el('label', { className: 'row' }, this.all, 'nodes that never ran, too'), this.list);
  }

  update(side) {
    const { name, nodes } = side.behavior_tree, states = side.tree_states;
    refresh(this.list, `${side.index} ${JSON.stringify(side.behavior_tree)}`, () => {
      this.drawn = null;
      this.rows = nodes.map(([depth, label, kind]) => {
        const row = el('li', { className: 'never' }, el('i', {}), el('span', { className: kind }, label), el('b', {}), el('small', {}));
        row.style.setProperty('--depth', depth);
        return row;
      });
      return this.rows;
    });
    if (!states || states.nodes.length !== nodes.length || this.drawn === states) return;
    this.drawn = states;
    states.nodes.forEach(([state, ticks, failures], index) => {
      const row = this.rows[index], [kind, word] = STATES[state], [, label, times, why] = row.children;
      if (row.className !== kind) row.className = kind;
      const text = !ticks ? '' : `${state === 1 ? 'running · ' : ''}${ticks.toLocaleString('en')}×${failures ? ` · ${failures.toLocaleString('en')} failed` : ''}`;
      if (times.textContent !== text) times.textContent = text;
      label.title = `${nodes[index][2]}, ${word}; ${ticks} ${ticks === 1 ? 'tick' : 'ticks'}, ${failures} failed`;
      const reason = states.messages[index] ?? '';
      if (why.textContent !== reason) why.textContent = reason;
    });
    const [state, ticks] = states.nodes[0], many = states.recoveries === 1 ? '1 recovery' : `${states.recoveries} recoveries`;
    this.head.replaceChildren(el('b', {}, name.split('/').at(-1)), el('span', {}, `${STATES[state][1]}, ${ticks.toLocaleString('en')} ${ticks === 1 ? 'tick' : 'ticks'}, ${many}`));
  }
}
