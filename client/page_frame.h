// The frame of a report, and how it looks.
#pragma once

#include <string_view>

namespace itn {

// {title}, {style}, {body}, {script}.
inline constexpr std::string_view kReportPage = R"(<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<main>
{body}</main>
<script>{script}</script>
</body>
</html>
)";

inline constexpr std::string_view kReportStyle = R"(
:root {
  color-scheme: light dark;
  --page: #f6f5f2; --card: #fff; --text: #1d1d1f; --soft: #66656b; --line: #e2e0da;
  --track: #e9e7e1; --good: #e6f2e9; --good-line: #3a8a55; --care: #fdf3df; --care-line: #c98a1b;
  --grave: #fdeaea; --grave-line: #c63a3a;
  --Y: #55545c; --R: #cc3d3d; --G: #2f8f4e; --B: #3869c9;
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #161618; --card: #1f1f23; --text: #ececf0; --soft: #a2a1aa; --line: #34343a;
    --track: #34343a; --good: #1b2a20; --good-line: #58b377; --care: #2d2616; --care-line: #d9a441;
    --grave: #331c1e; --grave-line: #e86a6a;
    --Y: #b9b8c2; --R: #f07070; --G: #5cc27d; --B: #7ba4f5;
  }
}
* { box-sizing: border-box; }
body {
  margin: 0; background: var(--page); color: var(--text);
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif;
  overflow-wrap: break-word;
}
main { max-width: 58rem; margin: 0 auto; padding: 2rem 1rem 3rem; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0; letter-spacing: -.01em; overflow-wrap: anywhere; }
h2 { font-size: 1.1rem; margin: 0 0 .75rem; }
p { margin: 0 0 .75rem; }
header { margin-bottom: 1.25rem; }
header p, .soft, figcaption { color: var(--soft); font-size: .9rem; }
header p { margin: .25rem 0 0; }
section {
  background: var(--card); border: 1px solid var(--line); border-radius: 12px;
  padding: 1.1rem 1.25rem 1.25rem; margin-bottom: 1rem;
}
section.trust { border-left: 5px solid var(--good-line); background: var(--good); }
section.trust.care { border-left-color: var(--care-line); background: var(--care); }
section.trust.grave { border-left-color: var(--grave-line); background: var(--grave); }
.trust ul { margin: 0; padding-left: 1.2rem; }
.trust li.grave { font-weight: 600; }
.trust p { margin: 0; }
figure { margin: 0; }
figcaption { margin-top: .4rem; }
img {
  display: block; width: 100%; height: auto; border-radius: 8px;
  outline: 1px solid var(--line); outline-offset: -1px;
}
.row { display: grid; grid-template-columns: repeat(auto-fit, minmax(9.5rem, 1fr)); gap: .9rem; }
.row + .name, .row + ul + .name { margin-top: 1.25rem; }
.name { font-weight: 600; margin-bottom: .5rem; }
.panel img { image-rendering: pixelated; }
ul.soft { margin: .5rem 0 0; padding-left: 1.2rem; }
table { width: 100%; border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .3rem .5rem; font-weight: 400; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
th:last-child, td:last-child { padding-right: 0; }
thead th { color: var(--soft); font-size: .85rem; vertical-align: bottom; }
thead th:last-child { white-space: normal; }
sub { line-height: 0; }
.legend { margin: .9rem 0 0; }
tbody th.parameter { border-top: 1px solid var(--line); padding-top: .7rem; white-space: normal; }
.parameter b { font-size: 1.05rem; }
.parameter .soft { float: right; }
td.best { font-weight: 600; }
td.bar { width: 38%; }
.dot { display: inline-block; width: .7em; height: .7em; border-radius: 50%; margin-right: .45em; }
svg { display: block; width: 100%; height: 14px; overflow: visible; }
.track { fill: var(--track); }
.c-Y { color: var(--Y); } .c-R { color: var(--R); } .c-G { color: var(--G); } .c-B { color: var(--B); }
.dot { background: currentColor; }
.span { fill: currentColor; opacity: .42; }
.mark { fill: currentColor; }
details { border-top: 1px solid var(--line); padding: .55rem 0; }
details:last-of-type { padding-bottom: 0; }
summary { cursor: pointer; }
summary span { color: var(--soft); font-size: .9rem; }
.snippet { position: relative; margin-top: .6rem; }
pre {
  margin: 0; padding: .9rem; max-height: 26rem; overflow: auto; background: var(--page);
  border: 1px solid var(--line); border-radius: 8px; overflow-wrap: normal;
  font: .8rem/1.45 ui-monospace, "DejaVu Sans Mono", Menlo, Consolas, monospace;
}
button {
  position: absolute; top: .45rem; right: .45rem; padding: .2rem .7rem; font: inherit;
  font-size: .8rem; color: var(--text); background: var(--card); border: 1px solid var(--line);
  border-radius: 6px; cursor: pointer;
}
dl { display: grid; grid-template-columns: auto 1fr; gap: .25rem 1rem; margin: 0; }
dt { color: var(--soft); }
dd { margin: 0; overflow-wrap: anywhere; }
code { overflow-wrap: anywhere; font: .85em ui-monospace, "DejaVu Sans Mono", Menlo, Consolas, monospace; }
@media (max-width: 34rem) {
  main { padding: 1.25rem .6rem 2rem; }
  section { padding: .9rem .9rem 1rem; }
  th, td { padding: .28rem .3rem; font-size: .9rem; }
  table, thead, tbody { display: block; }
  thead tr, tr.values { display: grid; grid-template-columns: 4.5rem 1fr 1.7fr; }
  tbody tr:not(.values) { display: block; }
  thead th:last-child, td.bar:empty { display: none; }
  tbody th.parameter { display: block; }
  td.bar { grid-column: 1 / -1; width: auto; padding: 0 0 .5rem; }
  .parameter .soft { float: none; display: block; }
  .row { grid-template-columns: repeat(auto-fit, minmax(8rem, 1fr)); gap: .6rem; }
}
@media print { section { break-inside: avoid; } button { display: none; } }
)";

// Copying is the only thing that needs it; without it there are no buttons.
inline constexpr std::string_view kReportScript = R"(
for (const button of document.querySelectorAll("button")) {
  button.hidden = false;
  button.onclick = async () => {
    const snippet = button.parentElement.querySelector("pre");
    try {
      await navigator.clipboard.writeText(snippet.textContent);
    } catch {
      getSelection().selectAllChildren(snippet);
      document.execCommand("copy");
    }
    button.textContent = "Copied";
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  };
}
)";

}  // namespace itn
