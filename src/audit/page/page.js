// Puts the page together from what its data have.

(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const root = document.getElementById("page");
  const { audit } = data;
  const [listeners, starters] = [[], []];
  let chosen;
  const page = {
    audit, drawing: data.drawing,
    onchoice: listener => listeners.push(listener),
    onshow: starter => starters.push(starter),
    choose(at) {
      const before = chosen;
      chosen = at;
      listeners.forEach(listener => listener(at, before));
      const hash = `#node=${encodeURIComponent(audit.nodes[at].name)}`;
      if (location.hash !== hash) history.replaceState(null, "", hash);
    },
  };
  const heading = words => element("h2", {}, words);
  const theme = element("button", { type: "button", onclick: () => {
    const isDark = getComputedStyle(document.documentElement).colorScheme === "dark";
    document.documentElement.dataset.theme = isDark ? "light" : "dark";
  } }, "light / dark");

  const facts = audit ? [
    ["opset", audit.graph.opset], ["written by", audit.graph.producer], ["second party", audit.runtime], ["inputs", audit.inputs],
    ["took", `${figure(audit.seconds)} s`], ["SHA-256", `${audit.graph.sha256.slice(0, 12)}…`],
  ] : data.facts ?? [];
  const verdict = audit?.verdict ?? data.verdict;
  root.append(
    element("header", {},
      element("div", { class: "top" }, element("h1", {}, audit?.graph.path ?? data.title), verdict ? badge(verdict, true) : "", theme),
      element("p", { class: "facts" }, facts.filter(([, value]) => value !== "").map(([name, value]) => element("span", {}, `${name}: ${value}`)))),
    element("div", { class: "answers" }, (data.answers ?? []).map(answer =>
      element("section", {}, element("h2", {}, answer.question), answer.sentences.map(sentence => element("p", {}, sentence))))));

  if (data.surfaces?.length) root.append(heading("The error on the surface"), ...surfaceView(data.surfaces));
  for (const table of (data.tables ?? []).filter(each => each.rows.length)) {
    root.append(heading(table.title), plainTable(table.head, table.rows));
  }
  if (audit) {
    root.append(heading("Along the graph: largest difference as a share of its bound"), strip(page));
    root.append(heading("The graph"));
    if (data.drawing) root.append(element("div", { class: "split" }, graph(page), details(page)));
    else root.append(element("p", { class: "soft" }, `${count(audit.nodes.length)} nodes are too many to draw.`), details(page));
    root.append(heading("Nodes"), ...nodeTable(page));
    if (audit.outputs.length) {
      root.append(heading("Outputs, end to end"), plainTable(["output", "largest difference", "rms", "noise floor, rms"],
        audit.outputs.map(output => [output.name, figure(output.cumulative), figure(output.cumulative_rms), figure(output.noise_floor)])));
    }
    if (audit.shipped) {
      const { shipped } = audit;
      root.append(heading(`As shipped: optimisation ${shipped.level}, ${shipped.nodes[0]} → ${shipped.nodes[1]} nodes`), element("p", {}, badge(shipped.verdict, true)),
        plainTable(["tensor", "grade", "identical", "largest difference", "changes at"],
          shipped.tensors.map(each => [each.name, each.verdict, each.identical ? "yes" : "no", figure(each.abs_max), each.changed_at ?? "–"])));
    }
    const { coverage } = audit;
    root.append(heading("Coverage"), element("p", {},
      `${count(coverage.compared)} of ${count(coverage.nodes)} nodes, ${count(coverage.elements_compared)} of ${count(coverage.elements)} elements compared.`));
    if (coverage.unsupported.length) root.append(plainTable(["operator", "what is not understood", "nodes"], coverage.unsupported.map(each => [each.op, each.why, each.count])));
    for (const [words, names] of [["Tensors that the second party lacks", coverage.missing], ["Tensors of the second party that the graph lacks", coverage.unmatched]]) {
      if (names.length) root.append(element("h4", {}, `${words} (${names.length})`), element("p", {}, names.slice(0, 200).join(", ") + (names.length > 200 ? " …" : "")));
    }
  }
  const notes = audit?.notes ?? data.notes ?? [];
  if (notes.length) root.append(heading("Notes"), ...notes.map(note => element("p", {}, note)));

  starters.forEach(start => start());
  if (audit?.nodes.length) {
    const asked = () => audit.nodes.findIndex(node => `#node=${encodeURIComponent(node.name)}` === location.hash);
    const first = audit.first_outside ? audit.nodes.findIndex(node => node.name === audit.first_outside.node) : -1;
    if (asked() >= 0) page.choose(asked());
    else if (first >= 0) page.choose(first);
    window.addEventListener("hashchange", () => { if (asked() >= 0 && asked() !== chosen) page.choose(asked()); });
  }
})();
