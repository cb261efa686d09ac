// What is wrong with the text of a page: overlaps, what lies outside of it, broken words.
const boxes = [], broken = [], visible = box => box.width > 1 && box.height > 1;
for (const text of document.querySelectorAll("svg text")) {
  const box = text.getBoundingClientRect(), style = getComputedStyle(text);
  if (visible(box) && text.textContent.trim() && style.visibility !== "hidden" && style.opacity !== "0")
    boxes.push([text.textContent, box.left, box.top, box.right, box.bottom]);
}
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
for (let node = walker.nextNode(); node; node = walker.nextNode()) {
  const home = node.parentElement;
  if (home.closest("script, style, svg, option")) continue;
  const range = document.createRange();
  for (const word of node.textContent.matchAll(/[A-Za-z0-9]+/g)) {
    range.setStart(node, word.index); range.setEnd(node, word.index + word[0].length);
    const lines = new Set([...range.getClientRects()].filter(visible).map(box => Math.round(box.top)));
    if (lines.size > 1 && !home.closest("pre, .hash")) broken.push(word[0]);
  }
  if (!node.textContent.trim()) continue;
  range.selectNodeContents(node);
  if (home.closest(".scroll, pre, details:not([open])")) continue;
  for (const box of range.getClientRects())
    if (visible(box)) boxes.push([node.textContent.trim(), box.left, box.top, box.right, box.bottom]);
}
const overlaps = [], outside = [];
boxes.sort((a, b) => a[2] - b[2]);
boxes.forEach((a, k) => {
  if (a[1] < -1 || a[3] > innerWidth + 1) outside.push(a[0]);
  for (let n = k + 1; n < boxes.length && boxes[n][2] < a[4] - 1; n++) {
    const b = boxes[n], wide = Math.min(a[3], b[3]) - Math.max(a[1], b[1]), high = Math.min(a[4], b[4]) - b[2];
    if (wide > 1 && high > 2) overlaps.push(a[0] + " | " + b[0]);
  }
});
return {overlaps, outside, broken, boxes: boxes.length, scroll: document.documentElement.scrollWidth - innerWidth};
