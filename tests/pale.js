// texts whose contrast with what is behind them is below 4.5 (WCAG 2.1, AA); not those on pictures
const numbers = color => { const n = color.match(/[\d.]+/g).map(Number); return [...n, 1]; };
const light = color => color.slice(0, 3).map(c => c / 255)
  .map(c => c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4)
  .reduce((sum, c, k) => sum + [0.2126, 0.7152, 0.0722][k] * c, 0);
const over = (top, below) => [0, 1, 2].map(k => top[3] * top[k] + (1 - top[3]) * below[k]);
const behind = e => !e ? [255, 255, 255]
  : over(numbers(getComputedStyle(e).backgroundColor), behind(e.parentElement));
const pictured = e => e && (getComputedStyle(e).backgroundImage !== "none" || pictured(e.parentElement));
// what is drawn for a white ground and inverted on a dark one
const inverted = e => e && (getComputedStyle(e).filter.includes("invert") || inverted(e.parentElement));
const seen = (color, e) => inverted(e) ? color.map((c, k) => k < 3 ? 0.91 * 255 - 0.82 * c : c) : color;
const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), found = [];
while (walk.nextNode()) {
  const e = walk.currentNode.parentElement, text = walk.currentNode.textContent.trim();
  if (!text || !e.checkVisibility() || e.closest("[disabled], .disabled, style, script, title")) continue;
  if (pictured(e)) continue;
  const style = getComputedStyle(e), ground = behind(e);
  const color = e instanceof SVGElement ? style.fill : style.color;
  const [low, high] = [light(over(seen(numbers(color), e), ground)), light(ground)].sort((a, b) => a - b);
  if ((high + 0.05) / (low + 0.05) < 4.5) found.push(text);
}
return found;
