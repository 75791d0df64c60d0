// Elements are made of text, never of markup: names in a graph are anyone's.
const SVG = "http://www.w3.org/2000/svg";

/** An element with properties and children; strings become text, nothing becomes nothing. */
function element(tag, properties, ...children) {
  const made = document.createElement(tag);
  return filled(made, properties, children);
}

/** The same in a drawing. */
function shape(tag, properties, ...children) {
  return filled(document.createElementNS(SVG, tag), properties, children);
}

function filled(made, properties, children) {
  for (const [name, value] of Object.entries(properties || {})) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value !== undefined && value !== null && value !== false) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.flat(Infinity).filter(child => child !== undefined && child !== null && child !== false));
  return made;
}

/** Three digits; ∞ is what JSON could not hold. */
function figure(x, absent = "–") {
  if (x === null || x === undefined) return absent;
  const size = Math.abs(x);
  if (size === 0) return "0";
  if (size >= 1e5 || size < 1e-3) return x.toExponential(1).replace("e+", "e");
  return x.toFixed(size >= 99.95 ? 0 : size >= 9.995 ? 1 : size >= 0.9995 ? 2 : 3);
}

/** A number in full, as f32 needs it. */
function full(x) {
  return x === null || x === undefined ? "not finite" : String(Number(x.toPrecision(9)));
}

/** All digits, in groups. */
function count(n) {
  return n.toLocaleString("en").replaceAll(",", "\u202f");
}

const GRADES = ["G3", "not-comparable", "G2", "G1", "G0"];
const MEANING = {
  G0: "bit for bit", G1: "ordinary rounding", G2: "unusual rounding", G3: "not rounding", "not-comparable": "not comparable",
};

function badge(grade, isLong) {
  const short = grade === "not-comparable" ? "n/c" : grade;
  const words = !isLong ? short : short === grade ? `${grade} ${MEANING[grade]}` : MEANING[grade];
  return element("span", { class: `badge ${grade}`, title: MEANING[grade] }, words);
}

/** The end of a long name: that is where names differ. */
function ending(text, most) {
  return text.length > most ? `…${text.slice(1 - most)}` : text;
}

/** The tensor that gives a node its verdict. */
function worstTensor(node) {
  const share = tensor => (tensor.csu_max === null ? Infinity : tensor.csu_max / Math.max(tensor.n_eff ?? Infinity, 1));
  const worse = (a, b) => (b.verdict === node.verdict) - (a.verdict === node.verdict) || share(b) - share(a);
  return [...node.tensors].sort(worse)[0];
}

/** A plain table: heads, and rows of texts. */
function plainTable(head, rows) {
  const cell = (tag, words) => (text, column) => element(tag, words(column) ? { class: "words" } : {}, String(text));
  const isWords = column => column === 0 || rows.length > 0 && rows.every(row => isNaN(parseFloat(row[column])));
  return element("div", { class: "plain" }, element("table", {},
    element("thead", {}, element("tr", {}, head.map(cell("th", isWords)))),
    element("tbody", {}, rows.map(row => element("tr", {}, row.map(cell("td", isWords)))))));
}
