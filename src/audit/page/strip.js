// All nodes from the graph's inputs to its outputs: how much of its bound each one takes, on a logarithmic scale.

function strip(page) {
  const nodes = page.audit.nodes;
  // As wide as the page makes it: bars may be stretched, letters stand beside the drawing.
  const [width, height, base] = [1000, 112, 110];
  const step = width / Math.max(nodes.length, 1);
  const [low, high] = [-4, 4];
  const y = share => base - (Math.min(Math.max(Math.log10(share), low), high) - low) / (high - low) * (base - 12);
  const drawing = shape("svg", { class: "strip", viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: "none", role: "img",
    "aria-label": "The share of its bound that each node takes, from the first node to the last" });
  const labels = [[1e-2, "10⁻² n"], [1, "n"], [100, "100 n"], [1e4, "10⁴ n"]].map(([share, label]) => {
    drawing.append(shape("line", { x1: 0, x2: width, y1: y(share), y2: y(share) }));
    return element("span", { style: `top: ${y(share)}px` }, label);
  });
  const marks = nodes.map((node, at) => {
    const tensor = worstTensor(node);
    const share = !tensor ? 1 : node.verdict === "G0" ? 0 : tensor.csu_max === null ? Infinity : tensor.csu_max / Math.max(tensor.n_eff ?? Infinity, 1);
    const top = y(Math.max(share, 1e-12));
    const mark = shape("rect", { x: at * step, y: Math.min(top, base - 2), width: Math.max(step * 0.82, 0.6), height: Math.max(base - top, 2),
      fill: `var(--${{ "not-comparable": "nc" }[node.verdict] ?? node.verdict.toLowerCase()})`, opacity: tensor ? 1 : 0.35 },
    shape("title", {}, `${node.name} (${node.op}): ${node.verdict}`));
    drawing.append(mark);
    return mark;
  });
  const cursor = shape("rect", { x: 0, y: 4, width: Math.max(step, 3), height: base - 4, fill: "none", stroke: "var(--mark)", "stroke-width": 2, visibility: "hidden" });
  drawing.append(cursor);
  drawing.addEventListener("click", event => {
    const box = drawing.getBoundingClientRect();
    const at = Math.floor(((event.clientX - box.left) / box.width * width) / step);
    if (at >= 0 && at < nodes.length) page.choose(at);
  });
  page.onchoice(at => {
    cursor.setAttribute("x", Number(marks[at].getAttribute("x")) - (Math.max(step, 3) - step * 0.82) / 2);
    cursor.setAttribute("visibility", "visible");
  });
  return element("div", { class: "along" }, element("div", { class: "labels" }, labels), drawing);
}
