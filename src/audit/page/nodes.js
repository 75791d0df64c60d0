// The table of nodes: sorted by any column, filtered by grade, operator and name.

/** Rows that are shown at once; a button shows as many more. */
const PORTION = 1000;

function nodeTable(page) {
  const rows = page.audit.nodes.map((node, at) => {
    const tensor = worstTensor(node);
    return { at, node, tensor, share: !tensor ? -1 : tensor.csu_max === null ? Infinity : tensor.csu_max / Math.max(tensor.n_eff ?? Infinity, 1) };
  });
  const number = value => (value === null || value === undefined ? -Infinity : value);
  const columns = [
    { name: "#", title: "Place in the graph's order", key: row => row.at, cell: row => String(row.at + 1) },
    { name: "node", words: true, key: row => row.node.name, cell: row => ending(row.node.name, 40) },
    { name: "operator", words: true, key: row => row.node.op, cell: row => ending(row.node.op, 24) },
    { name: "grade", words: true, title: "G0 bit for bit, G1 rounding, G2 unusual, G3 not rounding", descending: true,
      key: row => [-GRADES.indexOf(row.node.verdict), row.share], cell: row => badge(row.node.verdict) },
    { name: "csu", title: "Largest difference in condition-scaled ulps", descending: true,
      key: row => (row.tensor ? row.tensor.csu_max ?? Infinity : -Infinity), cell: row => (row.tensor ? figure(row.tensor.csu_max, "∞") : "–") },
    { name: "n", title: "Roundings that can pile up: more csu cannot be rounding", descending: true, key: row => number(row.tensor?.n_eff), cell: row => figure(row.tensor?.n_eff) },
    { name: "slope", title: "A factor common to the differences, less one", descending: true,
      key: row => Math.abs(number(row.tensor?.slope)) * (row.tensor?.slope == null ? -1 : 1), cell: row => figure(row.tensor?.slope) },
    { name: "slope z", title: "The slope in its standard deviations", descending: true,
      key: row => Math.abs(number(row.tensor?.slope_z)) * (row.tensor?.slope_z == null ? -1 : 1), cell: row => figure(row.tensor?.slope_z) },
    { name: "bits", title: "Effective bits: f32 about 22, f16 and tf32 about 12, bf16 about 9", key: row => row.tensor?.effective_bits ?? Infinity,
      cell: row => row.tensor?.effective_bits?.toFixed(1) ?? (row.tensor ? "exact" : "–") },
    { name: "undecidable", title: "Elements that depend on a decision closer than the rounding", descending: true,
      key: row => number(row.tensor?.undecidable), cell: row => (row.tensor ? count(row.tensor.undecidable) : "–") },
    { name: "compared", descending: true, key: row => number(row.tensor?.compared),
      cell: row => (!row.tensor ? "none" : row.tensor.compared === row.tensor.elements ? count(row.tensor.elements) : `${count(row.tensor.compared)} of ${count(row.tensor.elements)}`) },
    { name: "since inputs", title: "Largest difference from the reference's own chain", descending: true,
      key: row => number(row.tensor?.cumulative), cell: row => figure(row.tensor?.cumulative) },
  ];

  const grades = new Map(GRADES.filter(grade => rows.some(row => row.node.verdict === grade)).map(grade => [grade, true]));
  const operators = [...new Set(rows.map(row => row.node.op))].sort();
  let [column, isDescending, limit, chosen] = [columns[3], true, PORTION];

  const operator = element("select", { id: "operator", onchange: () => update() }, element("option", { value: "" }, "all"), operators.map(op => element("option", { value: op }, op)));
  const search = element("input", { id: "search", type: "search", size: "24", placeholder: "node, tensor, module", oninput: () => update() });
  const shown = element("span", { id: "shown", role: "status", class: "soft" });
  const filters = element("div", { class: "filters" },
    element("fieldset", {}, element("legend", {}, "Grade"), [...grades.keys()].map(grade => element("label", {},
      element("input", { type: "checkbox", checked: true, value: grade, onchange: event => { grades.set(grade, event.target.checked); update(); } }), " ", badge(grade, grade === "not-comparable"),
      element("span", { class: "soft" }, ` ${rows.filter(row => row.node.verdict === grade).length}`)))),
    element("label", {}, element("span", { class: "soft" }, "Operator "), operator),
    element("label", {}, element("span", { class: "soft" }, "Name "), search), shown);

  const heads = columns.map(of => element("th", { scope: "col", class: of.words && "words", title: of.title }, element("button", { type: "button", onclick: () => {
    isDescending = column === of ? !isDescending : Boolean(of.descending);
    column = of;
    update();
  } }, of.name)));
  const body = element("tbody", {});
  const more = element("button", { type: "button", onclick: () => { limit += PORTION; update(true); } }, "more rows");
  const lines = rows.map(row => {
    let line;
    return () => line ??= element("tr", { "data-node": row.at, tabindex: "0", onclick: () => page.choose(row.at),
      onkeydown: event => { if (event.key === "Enter") page.choose(row.at); } },
    columns.map(of => element("td", { class: of.words && "words", title: of.words && of.name !== "grade" && of.key(row) }, of.cell(row))));
  });

  function compare(a, b) {
    const [left, right] = [column.key(a), column.key(b)].map(key => (Array.isArray(key) ? key : [key]));
    for (let k = 0; k < left.length; k++) {
      const way = typeof left[k] === "string" ? left[k].localeCompare(right[k], "en", { numeric: true }) : left[k] === right[k] ? 0 : left[k] < right[k] ? -1 : 1;
      if (way) return isDescending ? -way : way;
    }
    return a.at - b.at;
  }
  function update(keepLimit) {
    if (!keepLimit) limit = PORTION;
    const wanted = search.value.trim().toLowerCase();
    const has = row => [row.node.name, row.node.source?.module ?? "", ...row.node.inputs, ...row.node.outputs].some(text => text.toLowerCase().includes(wanted));
    const found = rows.filter(row => grades.get(row.node.verdict) && (!operator.value || row.node.op === operator.value) && (!wanted || has(row)));
    found.sort(compare);
    columns.forEach((of, k) => (of === column ? heads[k].setAttribute("aria-sort", isDescending ? "descending" : "ascending") : heads[k].removeAttribute("aria-sort")));
    body.replaceChildren(...found.slice(0, limit).map(row => lines[row.at]()));
    shown.textContent = `${found.length} of ${rows.length} nodes`;
    more.hidden = found.length <= limit;
  }
  page.onchoice(at => {
    if (chosen !== undefined) lines[chosen]().classList.remove("chosen");
    lines[chosen = at]().classList.add("chosen");
  });
  update();
  return [filters, element("div", { class: "scroll" }, element("table", { id: "nodes" }, element("thead", {}, element("tr", {}, heads)), body)), more];
}
