// Charts of velocity and clearance over time; a click asks why the command of that moment was chosen.
const SPAN = 30, LEFT = 30, TOP = 24, BOTTOM = 18;

/** A round step (1, 2 or 5 times a power of ten) for about `count` ticks in a span. */
export function niceStep(span, count) {
  const power = 10 ** Math.floor(Math.log10(span / count));
  return [1, 2, 5, 10].map((k) => k * power).find((step) => span / step <= count);
}

export class Chart {
  /** `series`: [label, color of the theme, column of a sample, dashed]. */
  constructor(canvas, theme, unit, series, picked) {
    Object.assign(this, { canvas, theme, unit, series });
    canvas.addEventListener('click', (event) => {
      if (this.range) picked(this.range[0] + Math.max(0, event.offsetX - LEFT) / (canvas.clientWidth - LEFT) * SPAN);
    });
  }

  draw(samples, now) {
    const { canvas, theme } = this, ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width) return;
    if (canvas.width !== Math.round(width * ratio)) { canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio); }
    const c = canvas.getContext('2d'), end = Math.max(now, SPAN), begin = end - SPAN;
    this.range = [begin, end];
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, width, height);
    const shown = samples.filter((s) => s[0] >= begin - 1 && s[0] <= now + 1e-6);
    let low = 0, high = 0.1;
    for (const [, , column] of this.series) for (const s of shown) if (s[column] !== null) { low = Math.min(low, s[column]); high = Math.max(high, s[column]); }
    const y = (v) => height - BOTTOM - (v - low) / (high - low) * (height - TOP - BOTTOM), x = (t) => LEFT + (t - begin) / SPAN * (width - LEFT);
    c.font = '11px system-ui, "DejaVu Sans", sans-serif';
    c.fillStyle = theme.muted;
    c.strokeStyle = theme.line;
    c.lineWidth = 1;
    const rule = (x1, y1, x2, y2) => { c.beginPath(); c.moveTo(x1, y1); c.lineTo(x2, y2); c.stroke(); };
    const step = niceStep(high - low, 3), digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    c.textAlign = 'right';
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9; k++) {
      rule(LEFT, y(k * step), width, y(k * step));
      c.fillText((k * step).toFixed(digits), LEFT - 4, y(k * step) + 4);
    }
    c.fillText(this.unit, width - 5, 13);
    c.textAlign = 'center';
    for (let t = Math.ceil(begin / 10) * 10; t <= end; t += 10) {
      rule(x(t), height - BOTTOM, x(t), height - BOTTOM + 3);
      if (x(t) < width - 14) c.fillText(`${t} s`, Math.max(x(t), LEFT), height - 4);
    }
    c.textAlign = 'left';
    let left = 7;
    for (const [label, color, column, dashed] of this.series) {
      c.fillStyle = c.strokeStyle = theme[color];
      c.lineWidth = 1.6;
      c.setLineDash(dashed ? [4, 3] : []);
      c.beginPath();
      c.moveTo(left, 9.5);
      c.lineTo(left + 14, 9.5);
      c.stroke();
      c.fillStyle = theme.text;
      c.fillText(label, left + 18, 13);
      left += 30 + c.measureText(label).width;
      c.beginPath();
      let drawing = false;
      for (const s of shown) {
        if (s[column] === null) { drawing = false; continue; }
        if (drawing) c.lineTo(x(s[0]), y(s[column])); else c.moveTo(x(s[0]), y(s[column]));
        drawing = true;
      }
      c.stroke();
      c.setLineDash([]);
    }
  }
}
