// The graph in layers: pan by dragging or the wheel, zoom by Ctrl + wheel or the buttons, walk along the arcs by the arrow keys.

function graph(page) {
  const { drawing, audit } = page;
  const [wide, tall] = drawing.size_of_box;
  const world = shape("g", {});
  const paper = shape("svg", { role: "group", "aria-label": "The graph; arrow keys walk along its arcs, Enter chooses" }, world);
  const frame = element("div", { class: "frame view" }, paper);

  const above = audit.nodes.map(() => []);
  const below = audit.nodes.map(() => []);
  const near = audit.nodes.map(() => []);
  for (const [from, to, way] of drawing.arcs) {
    below[from].push(to);
    above[to].push(from);
    const arc = shape("path", { class: "arc", d: course(drawing.nodes[from], way, drawing.nodes[to]) });
    near[from].push(arc);
    near[to].push(arc);
    world.append(arc);
  }
  const boxes = audit.nodes.map((node, at) => {
    const [x, y] = drawing.nodes[at];
    const box = shape("g", { class: `node ${node.verdict}`, transform: `translate(${x - wide / 2} ${y - tall / 2})`, tabindex: "-1",
      role: "button", "aria-label": `${node.op} ${node.name}, ${MEANING[node.verdict]}`, "data-node": at,
      onclick: () => page.choose(at), onkeydown: event => walk(event, at), onfocus: () => reveal(at) },
    shape("rect", { width: wide, height: tall }),
    shape("text", { x: 9, y: 17 }, ending(node.op, 19)),
    shape("text", { x: wide - 8, y: 17, class: "grade" }, node.verdict === "not-comparable" ? "?" : node.verdict),
    shape("text", { x: 9, y: 32, class: "small" }, ending(node.name, 25)),
    shape("title", {}, node.name));
    world.append(box);
    return box;
  });

  function course(from, way, to) {
    const points = [[from[0], from[1] + tall / 2]];
    for (let k = 0; k < way.length; k += 2) points.push([way[k], way[k + 1] - tall / 2], [way[k], way[k + 1] + tall / 2]);
    points.push([to[0], to[1] - tall / 2]);
    let path = `M${points[0]}`;
    for (let k = 1; k < points.length; k++) {
      const [[x0, y0], [x1, y1]] = [points[k - 1], points[k]];
      path += x0 === x1 ? `L${x1} ${y1}` : `C${x0} ${(y0 + y1) / 2} ${x1} ${(y0 + y1) / 2} ${x1} ${y1}`;
    }
    return path;
  }

  // What of the drawing is seen: its point at the frame's corner, and the scale.
  const view = { x: 0, y: 0, scale: 1 };
  const room = () => [frame.clientWidth || 600, frame.clientHeight || 600];
  function show() {
    world.setAttribute("transform", `scale(${view.scale}) translate(${-view.x} ${-view.y})`);
    paper.classList.toggle("far", view.scale < 0.38);
  }
  function zoom(factor, x, y) {
    const [w, h] = room();
    const [atX, atY] = [x ?? w / 2, y ?? h / 2];
    const scale = Math.min(Math.max(view.scale * factor, 0.005), 4);
    view.x += atX / view.scale - atX / scale;
    view.y += atY / view.scale - atY / scale;
    view.scale = scale;
    show();
  }
  function pan(dx, dy) {
    view.x += dx / view.scale;
    view.y += dy / view.scale;
    show();
  }
  function centre(at, scale) {
    const [w, h] = room();
    view.scale = scale ?? view.scale;
    view.x = drawing.nodes[at][0] - w / 2 / view.scale;
    view.y = drawing.nodes[at][1] - h / 2 / view.scale;
    show();
  }
  function whole() {
    const [w, h] = room();
    view.scale = Math.min(w / drawing.size[0], h / drawing.size[1], 1.2);
    view.x = (drawing.size[0] - w / view.scale) / 2;
    view.y = (drawing.size[1] - h / view.scale) / 2;
    show();
  }
  /** Moves no more than needed for a node to be seen. */
  function reveal(at) {
    const [w, h] = room();
    const [x, y] = drawing.nodes[at];
    const [sx, sy] = [(x - view.x) * view.scale, (y - view.y) * view.scale];
    if (sx < 40 || sx > w - 40 || sy < 40 || sy > h - 40) centre(at);
  }

  let stop = 0;
  function rove(at) {
    boxes[stop]?.setAttribute("tabindex", "-1");
    stop = at;
    boxes[stop]?.setAttribute("tabindex", "0");
  }
  function walk(event, at) {
    const beside = side => {
      const [x, , rank] = drawing.nodes[at];
      const others = drawing.nodes.map(([ox, , other], k) => [k, (ox - x) * side, other]).filter(([k, way, other]) => other === rank && way > 0 && k !== at);
      return others.sort((a, b) => a[1] - b[1])[0]?.[0];
    };
    const to = { ArrowDown: () => below[at][0], ArrowUp: () => above[at][0], ArrowRight: () => beside(1), ArrowLeft: () => beside(-1) }[event.key];
    if (to) {
      const next = to();
      event.preventDefault();
      if (next !== undefined) { rove(next); boxes[next].focus(); }
    } else if (event.key === "Enter" || event.key === " ") {
      event.preventDefault();
      page.choose(at);
    }
  }

  let held = null;
  paper.addEventListener("pointerdown", event => { held = { x: event.clientX, y: event.clientY, moved: 0 }; });
  window.addEventListener("pointermove", event => {
    if (!held) return;
    held.moved += Math.abs(event.clientX - held.x) + Math.abs(event.clientY - held.y);
    pan(held.x - event.clientX, held.y - event.clientY);
    [held.x, held.y] = [event.clientX, event.clientY];
  });
  window.addEventListener("pointerup", () => { setTimeout(() => { held = null; }); });
  // A drag that ends on a node is no choice.
  paper.addEventListener("click", event => { if (held && held.moved > 6) event.stopPropagation(); }, true);
  paper.addEventListener("wheel", event => {
    event.preventDefault();
    const [left, top] = [paper.getBoundingClientRect().left, paper.getBoundingClientRect().top];
    if (event.ctrlKey) zoom(Math.exp(-event.deltaY / 200), event.clientX - left, event.clientY - top);
    else pan(event.deltaX, event.deltaY);
  }, { passive: false });

  const first = audit.first_outside ? audit.nodes.findIndex(node => node.name === audit.first_outside.node) : -1;
  const tool = (words, title, act) => element("button", { type: "button", title, "aria-label": title, onclick: act }, words);
  frame.append(
    element("div", { class: "tools" }, tool("+", "Zoom in", () => zoom(1.4)), tool("−", "Zoom out", () => zoom(1 / 1.4)),
      tool("whole", "Show the whole graph", whole),
      first >= 0 ? tool("first outside", "Go to the first node outside rounding", () => { page.choose(first); centre(first, 1); }) : ""),
    element("div", { class: "hint" }, "drag or wheel: move · Ctrl + wheel: zoom"));

  page.onchoice((at, before) => {
    if (before !== undefined) {
      boxes[before].classList.remove("chosen");
      near[before].forEach(arc => arc.classList.remove("near"));
    }
    boxes[at].classList.add("chosen");
    near[at].forEach(arc => arc.classList.add("near"));
    rove(at);
    reveal(at);
  });
  page.onshow(() => {
    if (!audit.nodes.length) return;
    rove(Math.max(first, 0));
    const [w, h] = room();
    if (Math.min(w / drawing.size[0], h / drawing.size[1]) > 0.6) whole();
    else { centre(Math.max(first, 0), 0.85); if (first < 0) { view.y = 0; show(); } }
  });
  return frame;
}
