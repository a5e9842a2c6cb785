"use strict";
// The curves of the log that is chosen: per force one figure over time and one over frequency.

const figures = panelData("figures"), plots = all(".plot"), log = document.getElementById("log");
const coarse = matchMedia("(pointer: coarse)").matches; // fingers scroll the page

function show(k) {
  figures[k].flat().forEach(({data, layout}, i) =>
    Plotly.react(plots[i], data, coarse ? {...layout, dragmode: false} : layout, {responsive: true, displayModeBar: false}));
  all("[data-log]").forEach(part => { part.hidden = +part.dataset.log !== k; });
}
if (log) log.addEventListener("change", () => show(+log.value));
show(0);
