// Opens the sample viewer pages in a headless Chromium and looks at what they show.
//   node viewer_test.mjs CHROMIUM FOLDER      FOLDER: what slide_make_samples has written
// Screenshots are left in FOLDER. Uses nothing but Node's own modules: Chromium is driven through its debugging pipe.
import assert from 'node:assert/strict';
import {spawn} from 'node:child_process';
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import {pathToFileURL} from 'node:url';
import zlib from 'node:zlib';

const [chromium, folder] = process.argv.slice(2);

// --- the browser ---------------------------------------------------------------------------------------------------
class Browser {
  constructor() {
    this.profile = fs.mkdtempSync(path.join(os.tmpdir(), 'viewer-test-'));
    this.process = spawn(chromium, [
      '--headless', '--no-sandbox', '--remote-debugging-pipe', `--user-data-dir=${this.profile}`, '--no-first-run',
      '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--hide-scrollbars', '--disable-quic',
      '--disable-background-networking', '--disable-component-update', '--disable-sync', '--disable-dev-shm-usage',
    ], {stdio: ['ignore', 'ignore', 'ignore', 'pipe', 'pipe']});
    this.waiting = new Map();
    this.listeners = [];
    this.nextId = 1;
    let text = '';
    this.process.stdio[4].setEncoding('utf8').on('data', (data) => {
      text += data;
      const messages = text.split('\0');
      text = messages.pop();
      for (const message of messages) this.receive(JSON.parse(message));
    });
    this.ended = new Promise((resolve) => this.process.on('exit', resolve));
  }

  receive(message) {
    if (message.id) {
      const {resolve, reject} = this.waiting.get(message.id);
      this.waiting.delete(message.id);
      if (message.error) reject(new Error(message.error.message));
      else resolve(message.result);
    } else {
      for (const listener of this.listeners) listener(message);
    }
  }

  send(method, params = {}, sessionId = undefined) {
    const id = this.nextId++;
    this.process.stdio[3].write(JSON.stringify({id, method, params, sessionId}) + '\0');
    return new Promise((resolve, reject) => this.waiting.set(id, {resolve, reject}));
  }

  async close() {
    await this.send('Browser.close').catch(() => {});
    await this.ended;
    fs.rmSync(this.profile, {recursive: true, force: true});
  }
}

class Page {
  // A page with the file open; `before` runs in it before its own script.
  static async open(browser, file, {width = 800, height = 600, ratio = 1, still = true, before = ''} = {}) {
    const page = new Page();
    page.browser = browser;
    page.problems = [];
    const {targetId} = await browser.send('Target.createTarget', {url: 'about:blank'});
    page.targetId = targetId;
    page.session = (await browser.send('Target.attachToTarget', {targetId, flatten: true})).sessionId;
    browser.listeners.push((message) => page.watch(message));
    for (const domain of ['Page', 'Runtime', 'Log', 'Network']) await page.send(`${domain}.enable`);
    await page.send('Emulation.setDeviceMetricsOverride', {width, height, deviceScaleFactor: ratio, mobile: false});
    await page.send('Emulation.setEmulatedMedia',
                    {features: [{name: 'prefers-reduced-motion', value: still ? 'reduce' : 'no-preference'}]});
    if (before) await page.send('Page.addScriptToEvaluateOnNewDocument', {source: before});
    await page.send('Page.navigate', {url: pathToFileURL(path.join(folder, file)).href});
    for (let i = 0; i < 300; ++i) {
      page.state = await page.evaluate('document.documentElement?.dataset.state');
      if (page.state) break;
      await sleep(100);
    }
    await page.settle();
    page.box = await page.evaluate(`(() => { const b = document.getElementById('photo').getBoundingClientRect();
      return {left: b.left, top: b.top, width: b.width, height: b.height}; })()`);
    return page;
  }

  watch({method, params, sessionId}) {
    if (sessionId !== this.session) return;
    if (method === 'Runtime.exceptionThrown') this.problems.push(params.exceptionDetails.text);
    if (method === 'Log.entryAdded' && params.entry.level === 'error') this.problems.push(params.entry.text);
    if (method === 'Network.requestWillBeSent' && !/^(data|file|blob):/.test(params.request.url)) {
      this.problems.push(`asks for ${params.request.url}`);
    }
  }

  send(method, params = {}) { return this.browser.send(method, params, this.session); }

  async evaluate(expression) {
    const {result, exceptionDetails} =
        await this.send('Runtime.evaluate', {expression, awaitPromise: true, returnByValue: true});
    assert.equal(exceptionDetails, undefined);
    return result.value;
  }

  // Long after the camera's time constant, in frames that were really drawn.
  settle() {
    return this.evaluate(`new Promise((done) => {
      const begin = performance.now();
      let frames = 0;
      const wait = () => ++frames > 12 && performance.now() - begin > 1300 ? done() : requestAnimationFrame(wait);
      wait();
    })`);
  }

  // Moves the pointer to where it calls the camera to (x, y).
  async point(x, y) {
    const {left, top, width, height} = this.box;
    await this.send('Input.dispatchMouseEvent', {
      type: 'mouseMoved', x: left + width / 2 + x * width / 2, y: top + height / 2 + y * height / 2});
    await this.settle();
  }

  async key(key) {
    await this.send('Input.dispatchKeyEvent', {type: 'keyDown', key, code: key});
    await this.send('Input.dispatchKeyEvent', {type: 'keyUp', key, code: key});
  }

  capture() { return this.send('Page.captureScreenshot', {format: 'png'}).then(({data}) => data); }

  // What is on the screen once it no longer changes: frames may be on their way when the machine is busy.
  async screenshot(name) {
    let data = await this.capture();
    for (let i = 0, before = ''; before !== data && i < 20; ++i) {
      await sleep(150);
      before = data;
      data = await this.capture();
    }
    const bytes = Buffer.from(data, 'base64');
    if (name) fs.writeFileSync(path.join(folder, `${name}.png`), bytes);
    return decodePng(bytes);
  }

  async close() {
    assert.deepEqual(this.problems, []);
    await this.browser.send('Target.closeTarget', {targetId: this.targetId});
  }
}

const sleep = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));

// --- pictures ------------------------------------------------------------------------------------------------------
function decodePng(bytes) {
  let at = 8, header, data = [];
  while (at < bytes.length) {
    const length = bytes.readUInt32BE(at), type = bytes.toString('latin1', at + 4, at + 8);
    if (type === 'IHDR') header = bytes.subarray(at + 8, at + 8 + length);
    if (type === 'IDAT') data.push(bytes.subarray(at + 8, at + 8 + length));
    at += 12 + length;
  }
  const width = header.readUInt32BE(0), height = header.readUInt32BE(4);
  const channels = {2: 3, 6: 4}[header[9]];
  const raw = zlib.inflateSync(Buffer.concat(data)), stride = width * channels;
  const pixels = Buffer.alloc(stride * height);
  for (let y = 0; y < height; ++y) {
    const filter = raw[y * (stride + 1)];
    for (let i = 0; i < stride; ++i) {
      const a = i >= channels ? pixels[y * stride + i - channels] : 0;
      const b = y > 0 ? pixels[(y - 1) * stride + i] : 0;
      const c = i >= channels && y > 0 ? pixels[(y - 1) * stride + i - channels] : 0;
      const p = a + b - c, pa = Math.abs(p - a), pb = Math.abs(p - b), pc = Math.abs(p - c);
      const paeth = pa <= pb && pa <= pc ? a : pb <= pc ? b : c;
      pixels[y * stride + i] = raw[y * (stride + 1) + 1 + i] + [0, a, b, (a + b) >> 1, paeth][filter];
    }
  }
  return {width, height, at: (x, y) => [...pixels.subarray(y * stride + x * channels, y * stride + x * channels + 3)]};
}

// Area and centre of what is red, in screenshot pixels.
function redPart(image) {
  let area = 0, x0 = 0, y0 = 0;
  for (let y = 0; y < image.height; ++y) {
    for (let x = 0; x < image.width; ++x) {
      const [r, g] = image.at(x, y);
      if (r < 140 || g > 90) continue;
      ++area;
      x0 += x + 0.5;
      y0 += y + 0.5;
    }
  }
  return {area, x: x0 / area, y: y0 / area};
}

// Where a row changes between the wall's light and dark stripes, to a fraction of a pixel.
function stripeEdges(image, box, y) {
  const edges = [], middle = 128;
  for (let x = Math.ceil(box.left) + 8; x + 9 < box.left + box.width; ++x) {
    const a = image.at(x, y)[1], b = image.at(x + 1, y)[1];
    if ((a < middle) !== (b < middle)) edges.push(x + 0.5 + (middle - a) / (b - a));
  }
  return edges;
}

// --- what the sample scene must look like: 240×160, parallax 24 pixels, square of 53 pixels around (120.5, 80.5) -------
const WIDTH = 240, HEIGHT = 160, PARALLAX = 24, MARGIN = 24, SQUARE = 53;

function expected(box, focus, x, y) {
  const scale = box.width / (WIDTH - 2 * MARGIN);
  const place = (u, v, disparity) => ({
    x: box.left + (u - PARALLAX * x * (disparity - focus) - MARGIN) * scale,
    y: box.top + (v - PARALLAX * y * (disparity - focus) - MARGIN) * scale});
  const edges = [];
  for (let u = WIDTH / 16; u < WIDTH; u += WIDTH / 16) edges.push(place(u, 0, 0).x);
  return {scale, square: place(120.5, 80.5, 1), edges};
}

function checkView(image, page, focus, x, y) {
  const {scale, square, edges} = expected(page.box, focus, x, y);
  const red = redPart(image);
  assert.ok(Math.abs(red.x - square.x) < 0.6, `square at x = ${red.x}, not ${square.x}`);
  assert.ok(Math.abs(red.y - square.y) < 0.6, `square at y = ${red.y}, not ${square.y}`);
  // Neither more nor less: what it uncovers shows the wall, not a smear of the square.
  const side = Math.sqrt(red.area);
  assert.ok(Math.abs(side - SQUARE * scale) < 0.02 * SQUARE * scale, `square of ${side}, not ${SQUARE * scale}`);
  const row = Math.round(page.box.top) + 12;
  const found = stripeEdges(image, page.box, row);
  for (const edge of edges) {
    if (edge < page.box.left + 10 || edge > page.box.left + page.box.width - 10) continue;
    const distance = Math.min(...found.map((f) => Math.abs(f - edge)));
    assert.ok(distance < 0.6, `stripe at ${edge}: nearest edge is ${distance} away`);
  }
  assert.ok(found.length >= 8);
}

// --- the tests -----------------------------------------------------------------------------------------------------
const tests = {
  'near pixels move against the pointer and far ones do not, when the farthest plane stands still': async (browser) => {
    const page = await Page.open(browser, 'far_still.html');
    assert.equal(page.state, 'ready');
    const shots = {};
    for (const [name, x, y] of [['left', -1, 0], ['right', 1, 0], ['middle', 0, 0], ['up', 0, -0.8], ['part', 0.5, 0.25]]) {
      await page.point(x, y);
      shots[name] = await page.screenshot(`far_still_${name}`);
      checkView(shots[name], page, 0, x, y);
    }
    const moved = redPart(shots.left).x - redPart(shots.right).x;
    const scale = page.box.width / (WIDTH - 2 * MARGIN);
    assert.ok(Math.abs(moved - 2 * PARALLAX * scale) < 1, `parallax of ${moved}`);
    await page.close();
  },

  'far pixels move with the pointer and near ones do not, when the nearest plane stands still': async (browser) => {
    const page = await Page.open(browser, 'near_still.html');
    for (const [name, x, y] of [['left', -0.25, 0], ['right', 0.25, 0.5]]) {
      await page.point(x, y);
      checkView(await page.screenshot(`near_still_${name}`), page, 1, x, y);
    }
    await page.close();
  },

  'beyond the unit circle the camera stays on it': async (browser) => {
    const page = await Page.open(browser, 'far_still.html');
    await page.point(1, 1);
    checkView(await page.screenshot(), page, 0, Math.SQRT1_2, Math.SQRT1_2);
    await page.close();
  },

  'a single layer is drawn whole': async (browser) => {
    const page = await Page.open(browser, 'single.html');
    await page.point(0, 0);
    const image = await page.screenshot('single');
    const {square} = expected(page.box, 1, 0, 0);
    assert.ok(Math.abs(redPart(image).x - square.x) < 0.6);
    await page.close();
  },

  'arrow keys move the camera and Home brings it back': async (browser) => {
    const page = await Page.open(browser, 'far_still.html');
    for (let i = 0; i < 3; ++i) await page.key('ArrowRight');
    await page.key('ArrowDown');
    await page.settle();
    checkView(await page.screenshot(), page, 0, 0.75, 0.25);
    await page.key('Home');
    await page.settle();
    checkView(await page.screenshot(), page, 0, 0, 0);
    await page.close();
  },

  'a finger drags the photo': async (browser) => {
    const page = await Page.open(browser, 'far_still.html');
    await page.send('Emulation.setTouchEmulationEnabled', {enabled: true});
    const {left, top, width, height} = page.box;
    const finger = (x, y) => [{x: left + width * x, y: top + height * y}];
    await page.send('Input.dispatchTouchEvent', {type: 'touchStart', touchPoints: finger(0.5, 0.5)});
    for (const x of [0.48, 0.44, 0.4]) {
      await page.send('Input.dispatchTouchEvent', {type: 'touchMove', touchPoints: finger(x, 0.5)});
    }
    await page.send('Input.dispatchTouchEvent', {type: 'touchEnd', touchPoints: []});
    await page.settle();
    checkView(await page.screenshot(), page, 0, 0.4, 0);  // a tenth of the width to the left: 4 · 0.1 to the right
    await page.close();
  },

  'the device\'s tilt moves the camera': async (browser) => {
    const page = await Page.open(browser, 'far_still.html');
    const tilt = (beta, gamma) => page.evaluate(
        `window.dispatchEvent(new DeviceOrientationEvent('deviceorientation', {beta: ${beta}, gamma: ${gamma}}))`);
    await tilt(45, 3);
    await tilt(45, 10);
    await page.settle();
    checkView(await page.screenshot(), page, 0, 0.5, 0);
    await page.close();
  },

  'without anybody, the camera moves by itself, unless less motion is asked for': async (browser) => {
    const moving = await Page.open(browser, 'far_still.html', {still: false});
    const shot = async () => redPart(decodePng(Buffer.from(await moving.capture(), 'base64')));
    await sleep(3000);
    const first = await shot();
    await sleep(1500);
    const second = await shot();
    assert.ok(Math.hypot(second.x - first.x, second.y - first.y) > 5);
    await moving.close();
    const still = await Page.open(browser, 'far_still.html');
    await sleep(4500);
    checkView(await still.screenshot(), still, 0, 0, 0);
    await still.close();
  },

  'the canvas fits an upright, dense screen in its own pixels': async (browser) => {
    const page = await Page.open(browser, 'far_still.html', {width: 360, height: 740, ratio: 2});
    const canvas = await page.evaluate('(({width, height}) => ({width, height}))(document.getElementById("photo"))');
    assert.ok(page.box.width <= 360 && page.box.width > 300);
    assert.ok(Math.abs(canvas.width - 2 * page.box.width) < 1);
    assert.ok(Math.abs(canvas.width / canvas.height - (WIDTH - 2 * MARGIN) / (HEIGHT - 2 * MARGIN)) < 0.01);
    assert.ok(Math.abs(page.box.left - (360 - page.box.width) / 2) < 1, 'centred');
    await page.screenshot('upright');
    await page.close();
  },

  'without WebGL the photo is shown, with the reason': async (browser) => {
    const page = await Page.open(browser, 'far_still.html',
                                 {before: 'HTMLCanvasElement.prototype.getContext = () => null;'});
    assert.equal(page.state, 'still');
    assert.match(await page.evaluate('document.getElementById("message").innerText'), /WebGL/);
    const red = redPart(await page.screenshot('without_webgl'));
    // The photo at its own size, where the square has its ring of one pixel, which visibility hides, around it.
    assert.ok(Math.abs(Math.sqrt(red.area) - (SQUARE + 2)) < 1, `square of ${Math.sqrt(red.area)}`);
    await page.close();
  },

  'without scripts the photo is shown': async (browser) => {
    const page = await Page.open(browser, 'far_still.html');
    await page.send('Emulation.setScriptExecutionDisabled', {value: true});
    await page.send('Page.reload');
    await sleep(1000);
    const red = redPart(await page.screenshot('without_scripts'));
    assert.ok(Math.abs(Math.sqrt(red.area) - (SQUARE + 2)) < 1, `square of ${Math.sqrt(red.area)}`);
    assert.ok(Math.abs(red.x - 400) < 2 && Math.abs(red.y - 300) < 2, 'centred');
    await page.close();
  },

  'the still gives way to the moving photo': async (browser) => {
    const page = await Page.open(browser, 'far_still.html');
    assert.equal(await page.evaluate('getComputedStyle(document.getElementById("still")).display'), 'none');
    assert.equal(await page.evaluate('getComputedStyle(document.getElementById("photo")).touchAction'), 'none');
    await page.close();
  },

  'in a frame, a finger scrolls the page around, or turns the photo': async (browser) => {
    const inside = fs.readFileSync(path.join(folder, 'far_still.html'), 'utf8');
    const text = inside.replaceAll('&', '&amp;').replaceAll('"', '&quot;');
    fs.writeFileSync(path.join(folder, 'embedded.html'), `<!DOCTYPE html><body style="margin:0;height:3000px">
      <iframe id="photo" style="display:block;width:600px;height:400px;border:0" srcdoc="${text}"></iframe><script>
      setInterval(() => { const state = frames[0].document.documentElement.dataset.state;
                          if (state) document.documentElement.dataset.state = state; }, 50);</script>`);
    const page = await Page.open(browser, 'embedded.html');
    assert.equal(page.state, 'ready');
    await page.send('Emulation.setTouchEmulationEnabled', {enabled: true});
    const before = redPart(await page.screenshot());
    const drag = async (dx, dy) => {
      const touch = (type, i) =>
          page.send('Input.dispatchTouchEvent', {type, touchPoints: i < 0 ? [] : [{x: 300 + i * dx, y: 200 + i * dy}]});
      await touch('touchStart', 0);
      for (let i = 1; i <= 15; ++i) {
        await touch('touchMove', i);
        await sleep(20);
      }
      await touch('touchEnd', -1);
      await page.settle();
    };
    await drag(-6, 0);
    assert.equal(await page.evaluate('window.scrollY'), 0);
    const after = redPart(await page.screenshot('embedded'));
    assert.ok(before.x - after.x > 2, `from ${before.x} to ${after.x}`);
    await drag(0, -10);
    assert.ok(await page.evaluate('window.scrollY') > 100, 'the page scrolls');
    await page.close();
  },

  'the title is shown as it was given': async (browser) => {
    const page = await Page.open(browser, 'far_still.html');
    assert.equal(await page.evaluate('document.title'), 'Sample <scene> & "more"');
    assert.equal(await page.evaluate('document.getElementById("photo").ariaLabel'), 'Sample <scene> & "more"');
    await page.close();
  },
};

const browser = new Browser();
let failed = 0;
for (const [name, test] of Object.entries(tests)) {
  try {
    await test(browser);
    console.log(`ok      ${name}`);
  } catch (error) {
    ++failed;
    console.log(`FAILED  ${name}\n${error.stack}`);
  }
}
await browser.close();
console.log(`${Object.keys(tests).length - failed} passed, ${failed} failed`);
process.exit(failed === 0 ? 0 : 1);
