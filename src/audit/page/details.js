// One node: what it is, where it was written, and everything that was measured on its tensors.

function details(page) {
  const panel = element("div", { class: "frame details", tabindex: "0", role: "region", "aria-label": "Details of the chosen node", "aria-live": "polite" });
  panel.append(element("p", { class: "soft" }, "Choose a node in the graph, the strip or the table."));

  const makers = new Map();
  page.audit.nodes.forEach((node, at) => node.outputs.forEach(name => name && makers.set(name, at)));
  const link = name => {
    if (!name) return "(none)";
    const maker = makers.get(name);
    return maker === undefined ? element("code", {}, name)
      : element("button", { class: "link", type: "button", onclick: () => page.choose(maker) }, name);
  };
  const between = (items, what) => items.flatMap((item, at) => at ? [what, item] : [item]);

  page.onchoice(at => {
    const node = page.audit.nodes[at];
    const first = page.audit.first_outside;
    const isFirst = first && first.node === node.name;
    panel.replaceChildren(
      element("h3", {}, node.name),
      element("p", {}, badge(node.verdict, true), ` ${node.op}, node ${at + 1} of ${page.audit.nodes.length}`),
      node.why ? element("p", {}, node.why) : "",
      isFirst ? cause(first) : "",
      node.source ? source(node.source) : "",
      ...(node.attributes.length ? [element("h4", {}, "Attributes"), list(node.attributes)] : []),
      element("h4", {}, "Reads"), element("p", {}, between(node.inputs.map(link), ", ")),
      element("h4", {}, "Makes"), element("p", {}, between(node.outputs.map(name => element("code", {}, name || "(none)")), ", ")),
      ...node.tensors.flatMap(tensor),
      ...(isFirst && first.worst.length ? [element("h4", {}, "Worst elements"), ...first.worst.map(worst)] : []),
    );
    panel.scrollTop = 0;
  });

  function list(rows) {
    return element("dl", {}, rows.map(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]));
  }

  function cause(first) {
    const found = first.hypothesis;
    return element("div", { class: "cause" },
      element("strong", {}, "The first node outside rounding."), " ",
      found ? [element("strong", {}, found.name), `: ${found.detail} (${figure(found.csu)} csu are left).`]
        : "None of the usual mistakes explains the numbers.",
      first.reproduction ? element("p", {}, "By itself, in ONNX's test layout: ", element("code", {}, first.reproduction)) : "");
  }

  function source(from) {
    return element("div", {}, element("h4", {}, "Source"),
      element("p", {}, element("code", {}, `${from.file}:${from.line}`), from.module ? ` in ${from.module}` : ""),
      from.code ? element("pre", {}, from.code.trim()) : "");
  }

  function tensor(found) {
    const rows = [
      ["compared", `${count(found.compared)} of ${count(found.elements)}${found.sample ? ` – ${found.sample}` : ""}`],
      ["csu", `at most ${figure(found.csu_max, "∞")}, 99.9 % below ${figure(found.csu_p999)}, rms ${figure(found.csu_rms)}`],
      ["n", `${figure(found.n_eff, "∞")} roundings can pile up`],
      ["difference", `${figure(found.abs_max, "∞")} absolute, ${figure(found.rel_max)} relative, ${figure(found.ulp_max)} ulp`],
      ["slope", found.slope === null ? "too few elements" : `${figure(found.slope)} (z ${figure(found.slope_z)}); mean z ${figure(found.mean_z)}`],
      ["effective bits", found.effective_bits === null ? "no difference" : found.effective_bits.toFixed(1)],
      ["undecidable", count(found.undecidable)],
    ];
    if (found.cumulative !== null) {
      rows.push(["since the inputs", `${figure(found.cumulative)} at most; came in ${figure(found.propagated)} rms; amplified ${figure(found.amplification)}×`]);
    }
    const special = found.special;
    for (const [what, key] of [["NaN", "nan"], ["infinite", "inf"], ["subnormal", "subnormal"]]) {
      const [is, ought] = [special[`${key}_found`], special[`${key}_expected`]];
      if (is || ought) rows.push([what, `${count(is)} found, ${count(ought)} expected`]);
    }
    return [
      element("h4", {}, `${found.name}  ${found.element} [${found.shape.join(", ")}]  `, badge(found.verdict)),
      list(rows),
      found.csu_max === 0 ? "" : histogram(found),
      found.worst ? worst(found.worst) : "",
    ];
  }

  function worst(at) {
    return element("pre", {}, [
      `${at.tensor}[${at.index.join(", ")}]`, `found     ${full(at.found)}`, `expected  ${full(at.expected)}`,
      ...(at.csu === null ? [] : [`csu       ${figure(at.csu)}`]), ...at.receptive_field.map(part => `from      ${part}`),
    ].join("\n"));
  }
  return panel;
}

/** Differences by decades of csu; heights are logarithmic, so that a single element shows beside a million. */
function histogram(tensor) {
  const counts = tensor.histogram;
  const [width, height, base] = [440, 118, 92];
  const step = width / counts.length;
  const most = Math.log10(1 + Math.max(...counts, 1));
  const labels = ["<10⁻³", "10⁻³", "10⁻²", "0.1", "1", "10", "100", "10³", "10⁴", "≥10⁵"];
  const drawing = shape("svg", { class: "histogram", viewBox: `0 0 ${width} ${height}`, role: "img",
    "aria-label": `Differences in decades of csu: ${counts.map((n, at) => `${labels[at]}: ${n}`).join("; ")}` });
  drawing.append(shape("line", { x1: 0, x2: width, y1: base, y2: base }));
  counts.forEach((n, at) => {
    const tall = n ? Math.max(2, Math.log10(1 + n) / most * (base - 18)) : 0;
    const middle = (at + 0.5) * step;
    if (n) drawing.append(shape("rect", { x: at * step + 4, y: base - tall, width: step - 8, height: tall }));
    if (n) drawing.append(shape("text", { x: middle, y: base - tall - 4, "text-anchor": "middle" }, n < 1e5 ? String(n) : n.toExponential(1).replace("e+", "e")));
    drawing.append(shape("text", { x: middle, y: base + 14, "text-anchor": "middle" }, labels[at] ?? ""));
  });
  if (tensor.n_eff > 0) {
    // Bin k ≥ 1 holds [10^(k−4), 10^(k−3)).
    const x = Math.min(Math.max(Math.log10(tensor.n_eff) + 4, 0), counts.length) * step;
    drawing.append(shape("line", { class: "limit", x1: x, x2: x, y1: 4, y2: base }), shape("text", { x: Math.min(x + 4, width - 14), y: 12 }, "n"));
  }
  drawing.append(shape("text", { x: width / 2, y: height - 1, "text-anchor": "middle" }, "csu"));
  return drawing;
}
