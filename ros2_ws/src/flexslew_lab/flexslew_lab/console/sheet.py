"""The style of the page, the key of its brake, and its notice when the server is silent."""

PRIMARY = "#1565c0"  # of buttons; white on it has a contrast of 5.7
SHEET = """
:root { --nicegui-default-padding: 0; --nicegui-default-gap: 0; }
body { background: #f4f5f7; font-size: 14px; }
.nicegui-content { padding: 0; display: block; width: 100%; }
.bench-header { background: #1f2937; color: white; padding: 4px 8px; }
.bench-top { display: flex; flex-wrap: wrap; gap: 4px 10px; align-items: center; width: 100%; }
.bench-top .q-btn { min-height: 34px; padding: 0 12px; }
.bench-note { font-size: 0.85em; padding: 0 0.7em 0.4em; overflow-wrap: anywhere; }
.bench-note[role=alert] { color: #b00020; }
.bench-header .bench-note { padding: 0; }
.bench-header .bench-note[role=alert] { color: #ffb4ab; }
.bench-notice { background: #fde68a; color: #3b2f00; border-radius: 4px; padding: 4px 10px; }
.bench-row { display: flex; flex-wrap: wrap; gap: 4px; }
#bench-line { font-variant-numeric: tabular-nums; overflow-wrap: anywhere; }
.bench-page { display: grid; grid-template-columns: minmax(320px, 400px) minmax(0, 1fr);
  gap: 6px; padding: 6px; align-items: start; }
.bench-left, .bench-middle { background: white; border: 1px solid #ddd; border-radius: 6px;
  padding: 6px; min-width: 0; }
.bench-field { width: 100%; margin: 4px 0; }
.bench-slider { padding: 0 12px; }
.bench-left .q-btn { margin: 2px 4px 2px 0; }
.bench-left .q-tab-panel { padding: 6px 2px; }
.bench-left .q-tab { padding: 0 6px; min-width: 0; }
.bench-left .q-tabs__content { flex-wrap: wrap; }
.bench-folder { border: 1px solid #ddd; border-radius: 4px; margin: 6px 0; padding: 2px 8px 6px;
  min-width: 0; width: 100%; }
.bench-grid > .bench-folder { border: 0; padding: 0; margin: 0; }
.bench-tools { display: grid; grid-template-columns: repeat(auto-fit, minmax(120px, 1fr));
  gap: 0 6px; align-items: center; }
.bench-grid { display: grid; grid-template-columns: 1fr 1fr; gap: 4px 8px; }
.bench-grid > * { min-width: 0; }
.bench-chart { width: 100%; height: 215px; }
.bench-left .bench-chart { height: 190px; }
.bench-scene { width: 100%; height: 300px; overflow: hidden; }
.bench-scene svg { width: 100%; height: 300px; }
.bench-table { max-height: 50vh; }
.bench-table td { overflow-wrap: anywhere; white-space: normal; cursor: pointer; }
.bench-table td:first-child { white-space: nowrap; overflow-wrap: normal; }
.bench-table tr:has(td) { vertical-align: top; }
.q-tooltip { background: #333; font-size: 12px; }
@media (prefers-reduced-motion: reduce) {
  *, ::before, ::after { transition-duration: 0.01ms !important;
    animation-duration: 0.01ms !important; }
}
@media (max-width: 800px) {
  .bench-page, .bench-grid { grid-template-columns: minmax(0, 1fr); }
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
