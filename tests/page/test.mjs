// Opens the pages of `vitruvian audit --html` in headless Chromium and uses them as a reader does.
//
// Usage: node test.mjs PAGES OUT: PAGES is a folder with clean and planted (.html and .json) and diff.html; OUT takes the screenshots.
// CHROMIUM names the browser where it is not /usr/bin/chromium.
import assert from "node:assert/strict";
import { mkdirSync, readFileSync } from "node:fs";
import { resolve } from "node:path";
import { pathToFileURL } from "node:url";
import Ajv from "ajv/dist/2020.js";
import { chromium } from "playwright-core";

const [pages, out] = process.argv.slice(2).map(path => resolve(path));
mkdirSync(out, { recursive: true });
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
});

const report = name => JSON.parse(readFileSync(`${pages}/${name}.json`, "utf8"));
const schema = new Ajv({ strict: false, validateFormats: false }).compile(JSON.parse(readFileSync(new URL("../../docs/audit.schema.json", import.meta.url), "utf8")));

/** Opens a page, hands it to the test, and asserts that it was quiet: no error, no warning, no request. */
async function visit(name, options, test) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, ...options });
  const page = await context.newPage();
  const words = [];
  const address = pathToFileURL(`${pages}/${name}.html`).href;
  page.on("console", message => words.push(`${message.type()}: ${message.text()}`));
  page.on("pageerror", error => words.push(`error: ${error.stack}`));
  page.on("request", request => { if (request.url().split("#")[0] !== address) words.push(`request: ${request.url()}`); });
  await page.goto(address);
  await test(page, address);
  // Chromium's own warnings about reading back from the drawing are about its driver, not the page.
  assert.deepEqual(words.filter(line => !line.includes("GPU stall")), [], name);
  await context.close();
  console.log(`${name}${options.colorScheme ? ` (${options.colorScheme})` : ""}: ok`);
}

const shot = (page, name) => page.screenshot({ path: `${out}/${name}.png`, fullPage: true });
const cells = (page, column) => page.locator(`#nodes tbody tr td:nth-child(${column})`).allTextContents();
const rows = page => page.locator("#nodes tbody tr").count();
const head = (page, name) => page.locator("#nodes th button", { hasText: new RegExp(`^${name}$`) });
const fits = page => page.evaluate(() => document.documentElement.scrollWidth <= window.innerWidth);

for (const name of ["clean", "planted"]) {
  assert.ok(schema(report(name)), `${name}.json against the schema: ${JSON.stringify(schema.errors?.slice(0, 3))}`);
}
{
  const wrong = report("planted");
  wrong.nodes[0].verdict = "fine";
  assert.ok(!schema(wrong), "the schema rejects a grade that is none");
}

await visit("clean", {}, async page => {
  const { nodes } = report("clean");
  assert.equal(await rows(page), nodes.length);
  assert.equal(await page.locator("svg .node").count(), nodes.length);
  assert.match(await page.locator(".answers section").first().innerText(), /No: all/);

  // Sorting: by any column, and back.
  await head(page, "#").click();
  assert.deepEqual(await cells(page, 1), nodes.map((_, at) => String(at + 1)));
  await head(page, "#").click();
  assert.deepEqual(await cells(page, 1), nodes.map((_, at) => String(nodes.length - at)));
  assert.equal(await page.locator('#nodes th[aria-sort="descending"]').innerText(), "#");
  await head(page, "csu").click();
  const csu = await page.locator("#nodes tbody tr").evaluateAll(lines => lines.map(line => Number(line.dataset.node)));
  const largest = at => Math.max(...nodes[at].tensors.map(tensor => tensor.csu_max ?? Infinity));
  assert.ok(csu.slice(1).every((at, k) => largest(csu[k]) >= largest(at) || nodes[at].tensors.length > 1), "sorted by csu");

  // Filtering: by operator, by name, by grade.
  const operator = nodes[0].op;
  await page.selectOption("#operator", operator);
  assert.equal(await rows(page), nodes.filter(node => node.op === operator).length);
  assert.ok((await cells(page, 3)).every(text => text === operator));
  await page.selectOption("#operator", "");
  await page.fill("#search", nodes.at(-1).outputs[0]);
  assert.ok(await page.locator(`#nodes tbody tr[data-node="${nodes.length - 1}"]`).isVisible());
  await page.fill("#search", "no such node");
  assert.equal(await rows(page), 0);
  assert.equal(await page.locator("#shown").innerText(), `0 of ${nodes.length} nodes`);
  await page.fill("#search", "");
  const exact = nodes.filter(node => node.verdict === "G0").length;
  await page.locator('.filters input[value="G0"]').uncheck();
  assert.equal(await rows(page), nodes.length - exact);
  await page.locator('.filters input[value="G0"]').check();

  // Choosing: by the table, the graph and the strip; the address follows.
  await page.locator("#nodes tbody tr").nth(2).click();
  const third = Number(await page.locator("#nodes tbody tr").nth(2).getAttribute("data-node"));
  assert.equal(await page.locator(".details h3").innerText(), nodes[third].name);
  assert.ok(page.url().endsWith(`#node=${encodeURIComponent(nodes[third].name)}`));
  await page.locator("svg .node").first().focus();
  await page.keyboard.press("Enter");
  assert.equal(await page.locator(".details h3").innerText(), nodes[0].name);
  await page.keyboard.press("ArrowDown");
  await page.keyboard.press("Enter");
  assert.notEqual(await page.locator(".details h3").innerText(), nodes[0].name);
  await page.locator(".strip").click({ position: { x: 600, y: 60 } });
  assert.ok(await page.locator(".strip rect[visibility=visible]").count());

  // Zooming and moving.
  const world = () => page.locator(".view > svg > g").getAttribute("transform");
  const before = await world();
  await page.getByRole("button", { name: "Zoom in" }).click();
  const zoomed = await world();
  assert.notEqual(zoomed, before);
  const frame = await page.locator(".view > svg").boundingBox();
  await page.mouse.move(frame.x + 30, frame.y + 200);
  await page.mouse.down();
  await page.mouse.move(frame.x + 90, frame.y + 240);
  await page.mouse.up();
  assert.notEqual(await world(), zoomed);
  await page.getByRole("button", { name: "Show the whole graph" }).click();
  assert.ok(await fits(page));
  await shot(page, "clean");
});

await visit("planted", {}, async (page, address) => {
  const { nodes, first_outside: first } = report("planted");
  assert.equal(await page.locator("svg .node.G3").count(), nodes.filter(node => node.verdict === "G3").length);
  assert.equal(await page.locator(".details h3").innerText(), first.node, "it opens at the first node outside");
  assert.ok(await page.locator(".details .cause").count());
  assert.equal((await cells(page, 4))[0], "G3", "the worst stand first");
  assert.ok(await page.locator(`svg .node.chosen.G3`).isVisible());
  assert.ok(await page.locator(".details .histogram rect").count() > 0);
  await shot(page, "planted");
  await page.goto(`${address}#node=${encodeURIComponent(nodes.at(-1).name)}`);
  await page.reload();
  assert.equal(await page.locator(".details h3").innerText(), nodes.at(-1).name, "an address opens at its node");
});
await visit("planted", { colorScheme: "dark", viewport: { width: 1000, height: 800 } }, async page => {
  assert.ok(await fits(page), "nothing is cut at 1000 pixels");
  await shot(page, "planted_dark_1000");
  const ground = () => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
  const dark = await ground();
  await page.getByRole("button", { name: "light / dark" }).click();
  assert.notEqual(await ground(), dark);
});

await visit("diff", {}, async page => {
  const canvas = page.locator(".view > canvas");
  await canvas.scrollIntoViewIfNeeded();
  const picture = () => canvas.evaluate(element => element.toDataURL());
  const painted = () => canvas.evaluate(element => {
    const gl = element.getContext("webgl");
    const pixels = new Uint8Array(4 * element.width * element.height);
    gl.readPixels(0, 0, element.width, element.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    return pixels.filter((value, at) => at % 4 === 3 && value > 0).length / (element.width * element.height);
  });
  assert.ok((await painted()) > 0.03, "the mesh is drawn");
  const before = await picture();
  const box = await canvas.boundingBox();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await page.mouse.down();
  await page.mouse.move(box.x + box.width / 2 + 120, box.y + box.height / 2 + 20, { steps: 4 });
  await page.mouse.up();
  const turned = await picture();
  assert.notEqual(turned, before, "dragging turns it");
  await canvas.focus();
  await page.keyboard.press("ArrowLeft");
  assert.notEqual(await picture(), turned, "so do the arrow keys");
  await page.mouse.wheel(0, -300);
  await page.locator("#scale-top").fill("50");
  assert.match(await page.locator(".legend").innerText(), /mm and more/);
  assert.ok(await fits(page));
  await shot(page, "diff");
});
await browser.close();
