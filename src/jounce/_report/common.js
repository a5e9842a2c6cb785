"use strict";
// What pages share: data that are packed into them, and tables on phones.

const TYPES = {f8: Float64Array, f4: Float32Array, i4: Int32Array};
const panelData = name => JSON.parse(document.getElementById(name + "-data").textContent);
const array = packed => new TYPES[packed.dtype](Uint8Array.from(atob(packed.bdata), c => c.charCodeAt(0)).buffer);
const all = selector => [...document.querySelectorAll(selector)];

// On phones each cell of other tables has its heading
all(".scroll:not(.values) > table").forEach(table => [...table.tBodies[0].rows].forEach(row =>
  [...row.cells].forEach((cell, k) => { cell.dataset.label = table.tHead.rows[0].cells[k].textContent; })));
