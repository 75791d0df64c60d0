// All nodes from the graph's inputs to its outputs: how much of its bound each one takes, on a logarithmic scale.

function strip(page) {
  const nodes = page.audit.nodes;
  const [width, height, left, base] = [1000, 130, 46, 112];
  const step = (width - left - 6) / Math.max(nodes.length, 1);
  const [low, high] = [-4, 4];
  const y = share => base - (Math.min(Math.max(Math.log10(share), low), high) - low) / (high - low) * (base - 12);
  const drawing = shape("svg", { class: "strip", viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: "none", role: "img",
    "aria-label": "The share of its bound that each node takes, in the graph's order" });
  for (const [share, label] of [[1e-4, "10⁻⁴"], [1e-2, "10⁻²"], [1, "n"], [100, "100 n"], [1e4, "10⁴ n"]]) {
    drawing.append(shape("line", { x1: left, x2: width, y1: y(share), y2: y(share) }), shape("text", { x: left - 5, y: y(share) + 4, "text-anchor": "end" }, label));
  }
  const marks = nodes.map((node, at) => {
    const tensor = worstTensor(node);
    const share = !tensor ? 1 : tensor.csu_max === null ? Infinity : tensor.csu_max / Math.max(tensor.n_eff ?? Infinity, 1);
    const top = y(Math.max(share, 1e-12));
    const mark = shape("rect", { x: left + at * step, y: Math.min(top, base - 2), width: Math.max(step * 0.82, 0.6), height: Math.max(base - top, 2),
      fill: `var(--${{ "not-comparable": "nc" }[node.verdict] ?? node.verdict.toLowerCase()})`, opacity: tensor ? 1 : 0.35 },
    shape("title", {}, `${node.name} (${node.op}): ${node.verdict}`));
    drawing.append(mark);
    return mark;
  });
  const cursor = shape("rect", { x: 0, y: 4, width: Math.max(step, 3), height: base, fill: "none", stroke: "var(--mark)", "stroke-width": 2, visibility: "hidden" });
  drawing.append(cursor, shape("text", { x: left, y: height - 4 }, "first node"), shape("text", { x: width - 6, y: height - 4, "text-anchor": "end" }, "last node"));
  drawing.addEventListener("click", event => {
    const box = drawing.getBoundingClientRect();
    const at = Math.floor(((event.clientX - box.left) / box.width * width - left) / step);
    if (at >= 0 && at < nodes.length) page.choose(at);
  });
  page.onchoice(at => {
    cursor.setAttribute("x", Number(marks[at].getAttribute("x")) - (Math.max(step, 3) - step * 0.82) / 2);
    cursor.setAttribute("visibility", "visible");
  });
  return drawing;
}
