// Charts of velocity and clearance over time; a click asks why the command of that moment was chosen.
const SPAN = 30;

export class Chart {
  /** `series`: [label, color of the theme, column of a sample, dashed]. */
  constructor(canvas, theme, unit, series, picked) {
    Object.assign(this, { canvas, theme, unit, series });
    canvas.addEventListener('click', (event) => {
      if (this.range) picked(this.range[0] + (event.offsetX / canvas.clientWidth) * SPAN);
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
    const y = (v) => height - 8 - (v - low) / (high - low) * (height - 30), x = (t) => (t - begin) / SPAN * width;
    c.font = '11px system-ui, "DejaVu Sans", sans-serif';
    c.fillStyle = theme.muted;
    c.strokeStyle = theme.line;
    c.lineWidth = 1;
    for (const v of low < 0 ? [low, 0, high] : [0, high]) {
      c.beginPath();
      c.moveTo(0, y(v));
      c.lineTo(width, y(v));
      c.stroke();
    }
    c.textAlign = 'right';
    c.fillText(`${high.toFixed(2)} ${this.unit}`, width - 5, 13);
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
