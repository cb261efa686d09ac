"""The style of the page, the key of its brake, and its notice when the server is silent."""

PRIMARY = "#1565c0"  # of buttons; white on it has a contrast of 5.7
SHEET = """
:root { --nicegui-default-padding: 0; --nicegui-default-gap: 0; color-scheme: light dark;
  --page: #f1f3f6; --panel: #ffffff; --line: #d5d9e0; --text: #1c2430; --dim: #566070;
  --refused: #b00020; --good: #1b6e35; --link: #1565c0; --notice: #fde68a; --on-notice: #3b2f00; }
@media (prefers-color-scheme: dark) {
  :root { --page: #0f1318; --panel: #181d24; --line: #39414d; --text: #e6e9ee; --dim: #a3adba;
    --refused: #ffb4ab; --good: #7fd699; --link: #90caf9; --notice: #4a3a05; --on-notice: #fde68a; }
  /* drawn for a white ground; the hues stay */
  .bench-page svg:not(.q-checkbox__svg), .bench-scene canvas {
    filter: invert(0.91) hue-rotate(180deg); }
}
body, .body--dark { background: var(--page) !important; color: var(--text); font-size: 14px; }
.bench-page a, .text-primary, .q-field--focused .q-field__label { color: var(--link) !important; }
.bench-page h2, .bench-dialog h2 { font-size: 1em; font-weight: 600; line-height: 1.6; margin: 0; }
.nicegui-content { padding: 0; display: block; width: 100%; }
.bench-header { background: var(--panel) !important; color: var(--text) !important;
  border-bottom: 1px solid var(--line); padding: 5px 8px; box-shadow: none; }
.bench-top, .bench-row { display: flex; flex-wrap: wrap; gap: 4px 8px; align-items: center; }
.bench-top { width: 100%; }
.bench-top > .bench-row { margin-left: auto; }
.bench-top .q-btn { min-height: 34px; padding: 0 12px; }
.bench-top .bench-field { width: 84px; margin: 0; }
#bench-state { display: flex; flex-wrap: wrap; gap: 0 12px; align-items: baseline;
  font-variant-numeric: tabular-nums; overflow-wrap: anywhere; }
#bench-state > * { min-width: 0; font-size: inherit; line-height: inherit; margin: 0; }
#bench-state .trial, #bench-state .time, #bench-state .active { font-weight: 600; }
#bench-state .testbed, #bench-state .tick { color: var(--dim); }
#bench-state .state { border: 1px solid var(--line); border-radius: 4px; padding: 0 6px; }
#bench-state .running { background: #1b6e35; color: white; border-color: #1b6e35; }
#bench-state .missed { color: var(--refused); }
.bench-note { font-size: 0.85em; padding: 0 0.4em 0.4em; overflow-wrap: anywhere; }
.bench-note[role=alert] { color: var(--refused); }
.bench-header .bench-note { padding: 0; }
.bench-notice { background: var(--notice); color: var(--on-notice); border-radius: 4px;
  padding: 4px 10px; }
.bench-page { display: grid; gap: 6px; padding: 6px; align-items: start;
  grid-template-columns: minmax(180px, 2fr) minmax(460px, 6fr) minmax(300px, 3fr); }
.bench-left, .bench-middle, .bench-right { background: var(--panel); border-radius: 6px;
  border: 1px solid var(--line); padding: 6px; min-width: 0; }
.bench-card { border: 1px solid var(--line); border-radius: 4px; margin: 4px 0; padding: 4px 6px;
  overflow-wrap: anywhere; }
.bench-card small, .bench-card div { color: var(--dim); }
.bench-card .ready, .bench-card .active { color: var(--good); }
.bench-card .active { font-weight: 600; }
.bench-card .q-btn, .bench-top .bench-row + .q-btn { overflow-wrap: anywhere; }
.bench-field { width: 100%; margin: 4px 0; }
.bench-slider { padding: 0 12px; box-sizing: border-box; }
.bench-page .q-btn { margin: 2px 4px 2px 0; padding: 2px 8px; max-width: 100%; }
.bench-right .q-tab-panel { padding: 6px 2px; }
.bench-right .q-tab-panels, .bench-dialog { background: var(--panel); color: var(--text); }
.bench-right .q-tab { padding: 0 2px; min-width: 0; min-height: 32px; }
.bench-right .q-tab__label { font-size: 13px; }
.bench-right .q-tab--inactive { opacity: 1; }
.bench-right .q-tabs__content { flex-wrap: wrap; justify-content: flex-start; }
.bench-folder { border: 1px solid var(--line); border-radius: 4px; margin: 6px 0;
  padding: 2px 8px 6px; min-width: 0; width: 100%; }
.bench-grid > .bench-folder { border: 0; padding: 0; margin: 0; }
.bench-tools { display: grid; grid-template-columns: repeat(5, minmax(0, auto));
  gap: 0 6px; align-items: center; }
.bench-grid { display: grid; grid-template-columns: 1fr 1fr; gap: 4px 8px; }
.bench-grid > * { min-width: 0; }
.bench-grid .bench-field { margin: 0; }
.bench-row[draggable] { cursor: grab; }
.bench-grid .bench-row { flex-wrap: nowrap; gap: 0 4px; }
.bench-grid .bench-chart { resize: vertical; overflow: hidden; }  /* by its lower right corner */
.bench-chart { width: 100%; height: clamp(120px, 35vh - 128px, 340px); }
.bench-right .bench-chart { height: 190px; }
.bench-scene, .bench-scene svg { width: 100%; height: clamp(170px, 30vh, 420px); }
.bench-scene { overflow: hidden; }
.bench-scene > div { height: 100%; }  /* the canvas takes its size */
.bench-page .q-uploader, .bench-page .q-uploader__header, .bench-page .q-uploader__list,
.bench-page .q-uploader__title, .bench-page .q-uploader__subtitle {
  background: var(--panel) !important; color: var(--text) !important; opacity: 1; }
.bench-page .q-uploader { width: 100%; }
.bench-table { width: 100%; max-height: 60vh; background: var(--panel); color: var(--text); }
.bench-table td { overflow-wrap: anywhere; white-space: normal; cursor: pointer; }
.bench-table td:first-child { white-space: nowrap; overflow-wrap: normal; }
.bench-table tr:has(td) { vertical-align: top; }
.q-tooltip { background: #333; font-size: 12px; }
.bench-dialog { padding: 12px; gap: 8px; }
.bench-dialog td { padding: 1px 10px 1px 0; }
summary { cursor: pointer; display: list-item; list-style: disclosure-closed inside; }
details[open] > summary { list-style-type: disclosure-open; }
details > .bench-field { max-width: 400px; }
:focus-visible { outline: 2px solid var(--link); outline-offset: 1px; }
@media (prefers-reduced-motion: reduce) {
  *, ::before, ::after { transition-duration: 0.01ms !important;
    animation-duration: 0.01ms !important; }
}
@media (min-width: 1000px) {  /* each column scrolls by itself */
  .q-page-container { height: 100vh; box-sizing: border-box; }
  .q-page, .nicegui-content, .bench-page { height: 100%; min-height: 0 !important; }
  .bench-page { grid-template-rows: minmax(0, 1fr); }
  .bench-left, .bench-middle, .bench-right { max-height: 100%; overflow-y: auto; }
}
@media (max-width: 999px) {
  .bench-page { grid-template-columns: minmax(0, 2fr) minmax(0, 3fr); }
  .bench-middle { grid-column: 1 / 3; grid-row: 1; }
  .bench-chart { height: 190px; }
}
@media (max-width: 600px) {
  .bench-page, .bench-grid { grid-template-columns: minmax(0, 1fr); }
  .bench-left, .bench-middle, .bench-right { grid-column: 1; grid-row: auto; }
  .bench-tools { grid-template-columns: 1fr 1fr; }
  .bench-top > .bench-row { margin-left: 0; }
}
"""
SCRIPT = """
// a space is the brake, not a click on what has the focus; fields to write in keep it
addEventListener("keydown", event => {
  const field = event.target.closest?.("input, textarea, select, [contenteditable]");
  if (event.code !== "Space" || field) return;
  event.preventDefault();
  event.stopPropagation();
  if (!event.repeat) document.getElementById("brake")?.click();
}, true);
addEventListener("keyup", event => {
  const field = event.target.closest?.("input, textarea, select, [contenteditable]");
  if (event.code === "Space" && !field) { event.preventDefault(); event.stopPropagation(); }
}, true);
// a key that an element on the page names works it, but not while a dialog is open
addEventListener("keydown", event => {
  const field = event.target.closest?.("input, textarea, select, [contenteditable]");
  if (field || event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
  if (document.querySelector(".q-dialog")) return;
  [...document.querySelectorAll("[aria-keyshortcuts]")]
    .find(e => e.getAttribute("aria-keyshortcuts") === event.key && e.checkVisibility())?.click();
});
// a chart as a file: the points that are drawn, or the picture on a white ground
function saveChart(place, kind) {
  const box = document.querySelector(`#c${place} .bench-chart`), svg = box.querySelector("svg");
  const words = document.querySelector(`#c${place} .q-field__native`).innerText.trim();
  const send = blob => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = `${words.replace(/\\W+/g, "_") || "chart"}.${kind.toLowerCase()}`;
    link.click();
  };
  if (kind === "CSV") {
    const {dataset, series} = getElement(box.id.slice(1)).chart.getOption();
    const names = series.map(one => one.name).filter(name => name?.includes("["));
    const {t, ...rows} = dataset[0].source;
    const lines = t.map((time, k) => [time, ...names.map((_, n) => rows[n][k] ?? "")].join(","));
    const head = ["time [s]", ...names].map(name => `"${name.replaceAll('"', '""')}"`).join(",");
    return send(new Blob([[head, ...lines, ""].join("\\n")], {type: "text/csv"}));
  }
  const text = new XMLSerializer().serializeToString(svg);
  if (kind === "SVG") return send(new Blob([text], {type: "image/svg+xml"}));
  const image = new Image(), canvas = document.createElement("canvas");
  image.onload = () => {
    [canvas.width, canvas.height] = [2 * svg.clientWidth, 2 * svg.clientHeight];
    const drawing = canvas.getContext("2d");
    drawing.fillStyle = "white";
    drawing.fillRect(0, 0, canvas.width, canvas.height);
    drawing.drawImage(image, 0, 0, canvas.width, canvas.height);
    canvas.toBlob(send);
  };
  image.src = `data:image/svg+xml,${encodeURIComponent(text)}`;
}
// rows of a table are chosen without a mouse, too
new MutationObserver(() => {
  for (const row of document.querySelectorAll(".bench-table tbody tr:not([tabindex])"))
    row.tabIndex = 0;
}).observe(document, {childList: true, subtree: true});
addEventListener("keydown", event => {
  const row = event.target.closest?.(".bench-table tbody tr");
  if (event.code === "Enter") row?.click();
});
// a page whose server is gone says what to do, in place of "trying to reconnect" for ever
const OTHER = "Another console answers here now, and this page is not its own: open the address " +
  "that its terminal shows.";
const NOBODY = "Nothing answers: the console has ended, or its machine is out of reach. The " +
  "charts hold what came last, and no button does anything. Open the address that a new one shows.";
let waited = 0, usual = "";
setInterval(async () => {
  const popup = document.getElementById("popup");
  const line = popup?.lastElementChild;
  if (!line) return;
  usual ||= line.textContent;
  if (popup.ariaHidden === "true") { waited = 0; line.textContent = usual; return; }
  popup.setAttribute("role", "alert");
  waited += 1;
  const answer = await fetch("/run/", {cache: "no-store"}).catch(() => null);
  if (answer?.status === 403) line.textContent = OTHER;
  else if (answer) line.textContent = usual;
  else if (waited > 3) line.textContent = NOBODY;
}, 2000);
"""
