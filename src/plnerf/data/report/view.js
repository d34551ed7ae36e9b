"use strict";
// Points, wires and clearances in parallel projection on a canvas.  All lengths in world units from the middle.
(() => {
  const data = JSON.parse(document.getElementById("view-data").textContent);
  const canvas = document.getElementById("view"), paper = canvas.getContext("2d");
  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const grid = new Uint16Array(bytes(data.xyz).buffer), label = bytes(data.label);
  // Pixels are 32-bit numbers, alpha first.
  const colour = data.colours.map((text) => {
    const rgb = parseInt(text.slice(1), 16);
    return [rgb >> 16, (rgb >> 8) & 255, rgb & 255];
  });
  const shown = data.colours.map(() => true);
  const PRESETS = { oblique: [-0.95, 0.3], side: [-Math.PI / 2, 0], top: [-Math.PI / 2, Math.PI / 2], along: [Math.PI, 0.06] };
  const SHARES = [0.5, 0.42, 0.58, 0.34, 0.66, 0.26, 0.74, 0.18, 0.82, 0.1, 0.9];
  let azimuth, elevation, target, zoom, pixels, depth, sheet, waiting = false, preset = "oblique";

  // Screen axes: right, up, and towards the reader.
  function axes() {
    const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    return [[-sa, ca, 0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]];
  }
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  function look(name) {
    preset = name;
    [azimuth, elevation] = [data.azimuth + PRESETS[name][0], PRESETS[name][1]];
    target = [0, 1, 2].map((k) => (data.low[k] + data.high[k]) / 2);
    const [right, up] = axes(), size = [0, 1, 2].map((k) => data.high[k] - data.low[k]);
    const extent = (axis) => Math.max(1e-9, dot(axis.map(Math.abs), size));
    zoom = 0.86 * Math.min(canvas.clientWidth / extent(right), canvas.clientHeight / extent(up));
    ask();
  }

  function ask() {
    if (!waiting) requestAnimationFrame(draw);
    waiting = true;
  }

  function draw() {
    waiting = false;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const W = Math.round(canvas.clientWidth * ratio), H = Math.round(canvas.clientHeight * ratio);
    if (!W || !H) return;
    if (!sheet || sheet.width !== W || sheet.height !== H) {
      [canvas.width, canvas.height] = [W, H];
      sheet = paper.createImageData(W, H);
      pixels = new Uint32Array(sheet.data.buffer);
      depth = new Float32Array(W * H);
    }
    const k = zoom * ratio, screen = axes();
    const project = (p) => {
      const q = [p[0] - target[0], p[1] - target[1], p[2] - target[2]];
      return [W / 2 + k * dot(q, screen[0]), H / 2 - k * dot(q, screen[1])];
    };
    drawPoints(W, H, k, screen, ratio);
    paper.putImageData(sheet, 0, 0);
    paper.lineCap = paper.lineJoin = "round";
    paper.font = `600 ${13 * ratio}px system-ui, sans-serif`;
    for (const mast of data.structures) line(mast.points.map(project), data.structure_colour, 4 * ratio, []);
    for (const wire of data.wires) line(wire.points.map(project), wire.colour, 2 * ratio, wire.dashed ? [9 * ratio, 5 * ratio] : []);
    const taken = [];
    for (const mast of data.structures) {
      const [x, y] = project(mast.points[1]);
      writeFree(mast.id, [[x, y - 10 * ratio], [x, y - 24 * ratio]], data.structure_colour, ratio, "center", taken);
    }
    for (const mark of data.marks) {
      const ends = mark.points.map(project);
      line(ends, data.mark_colour, 2.5 * ratio, []);
      const x = Math.max(ends[0][0], ends[1][0]) + 8 * ratio, y = (ends[0][1] + ends[1][1]) / 2;
      const places = [0, 17, -17, 34, -34].map((dy) => [x, y + dy * ratio]);
      writeFree(mark.text, places, data.mark_colour, ratio, "left", taken);
    }
    for (const wire of data.wires) {
      const places = SHARES.map((share) => project(wire.points[Math.round(share * (wire.points.length - 1))]));
      writeFree(wire.id, places, wire.colour, ratio, "center", taken);
    }
    drawScale(H, k, ratio);
    drawAxes(W, H, screen, ratio);
  }

  // Nearest point in each pixel, then darker where its neighbours stand out before it (eye-dome lighting).
  function drawPoints(W, H, k, [right, up, near], ratio) {
    pixels.fill(0xffffffff);
    depth.fill(-Infinity);
    const size = Math.round(Math.min(7 * ratio, Math.max(1.5 * ratio, k * data.edge * 1.5)));
    const row = (axis) => [axis[0] * data.step[0], axis[1] * data.step[1], axis[2] * data.step[2]];
    const start = [0, 1, 2].map((i) => data.corner[i] - target[i]);
    const [rx, ry, rz] = row(right), [ux, uy, uz] = row(up), [nx, ny, nz] = row(near);
    const r0 = dot(start, right), u0 = dot(start, up), n0 = dot(start, near);
    const packed = colour.map(([r, g, b]) => (0xff000000 | (b << 16) | (g << 8) | r) >>> 0);
    for (let i = 0, j = 0; i < label.length; i++, j += 3) {
      if (!shown[label[i]]) continue;
      const a = grid[j], b = grid[j + 1], c = grid[j + 2];
      const x = Math.round(W / 2 + k * (r0 + a * rx + b * ry + c * rz) - size / 2);
      const y = Math.round(H / 2 - k * (u0 + a * ux + b * uy + c * uz) - size / 2);
      if (x < 0 || y < 0 || x + size > W || y + size > H) continue;
      const towards = n0 + a * nx + b * ny + c * nz, value = packed[label[i]];
      for (let v = y; v < y + size; v++) {
        for (let at = v * W + x, end = at + size; at < end; at++) {
          if (towards <= depth[at]) continue;
          depth[at] = towards;
          pixels[at] = value;
        }
      }
    }
    const strength = (0.03 * k) / ratio, most = (20 * ratio) / k;
    for (let at = W; at < W * H - W; at++) {
      const mine = depth[at];
      if (mine === -Infinity) continue;
      let before = 0;
      for (let n = 0; n < 4; n++) {
        const ahead = depth[at + (n & 1 ? 1 : -1) * (n & 2 ? W : 1)] - mine;
        if (ahead > 0) before += ahead < most ? ahead : most;
      }
      if (!before) continue;
      const light = Math.max(0.5, Math.exp(-strength * before)), value = pixels[at];
      const r = (value & 255) * light, g = ((value >> 8) & 255) * light, b = ((value >> 16) & 255) * light;
      pixels[at] = (0xff000000 | (b << 16) | (g << 8) | r) >>> 0;
    }
  }

  // With a white edge, so that it shows before points of any colour.
  function line(points, stroke, width, dashes) {
    for (const [style, wide, dash] of [["rgba(255,255,255,.6)", width * 1.8, []], [stroke, width, dashes]]) {
      paper.beginPath();
      points.forEach(([x, y], i) => (i ? paper.lineTo(x, y) : paper.moveTo(x, y)));
      paper.setLineDash(dash);
      [paper.strokeStyle, paper.lineWidth] = [style, wide];
      paper.stroke();
    }
    paper.setLineDash([]);
  }

  function write(text, x, y, fill, ratio, align) {
    [paper.textAlign, paper.textBaseline, paper.lineWidth] = [align, "middle", 4 * ratio];
    [paper.strokeStyle, paper.fillStyle] = ["white", fill];
    paper.strokeText(text, x, y);
    paper.fillText(text, x, y);
  }

  // At the first of some places where no other text is; nowhere if all are taken.
  function writeFree(text, places, fill, ratio, align, taken) {
    const width = paper.measureText(text).width + 6 * ratio, height = 16 * ratio;
    for (const [x, y] of places) {
      const left = Math.max(0, Math.min(canvas.width - width, align === "left" ? x : x - width / 2));
      if (taken.some((box) => left < box[0] + box[2] && box[0] < left + width && Math.abs(y - box[1]) < height)) continue;
      taken.push([left, y, width]);
      write(text, align === "left" ? left : left + width / 2, y, fill, ratio, align);
      return;
    }
  }

  function drawScale(H, k, ratio) {
    const raw = (110 * ratio) / k, power = 10 ** Math.floor(Math.log10(raw));
    const length = power * (raw / power >= 5 ? 5 : raw / power >= 2 ? 2 : 1), x = 16 * ratio, y = H - 18 * ratio;
    line([[x, y], [x + length * k, y]], "#222", 3 * ratio, []);
    write(`${Number(length.toPrecision(3))} ${data.unit}`, x, y - 13 * ratio, "#222", ratio, "left");
  }

  function drawAxes(W, H, [right, up], ratio) {
    const x = W - 46 * ratio, y = H - 46 * ratio;
    for (let k = 0; k < 3; k++) {
      const [dx, dy] = [right[k] * 28 * ratio, -up[k] * 28 * ratio];
      if (Math.hypot(dx, dy) < 10 * ratio) continue;
      line([[x, y], [x + dx, y + dy]], "#555", 1.5 * ratio, []);
      write(data.axes[k], x + dx * 1.4, y + dy * 1.4, "#333", ratio, "center");
    }
  }

  function turn(dx, dy) {
    preset = null;
    azimuth -= dx * 0.007;
    elevation = Math.min(Math.PI / 2, Math.max(-0.35, elevation + dy * 0.007));
    ask();
  }

  function move(dx, dy) {
    preset = null;
    const [right, up] = axes();
    target = target.map((value, k) => value - (right[k] * dx - up[k] * dy) / zoom);
    ask();
  }

  // About a place of the screen, which stays where it is.
  function enlarge(factor, x, y) {
    const [dx, dy] = [x - canvas.clientWidth / 2, y - canvas.clientHeight / 2];
    move(-dx, -dy);
    zoom *= factor;
    move(dx, dy);
  }

  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = fingers.get(event.pointerId);
    if (!last) return;
    const now = [event.offsetX, event.offsetY], [dx, dy] = [now[0] - last[0], now[1] - last[1]];
    const other = [...fingers].find(([id]) => id !== event.pointerId)?.[1];
    if (other) {
      const apart = (p) => Math.max(8, Math.hypot(p[0] - other[0], p[1] - other[1]));
      move(dx / 2, dy / 2);
      enlarge(apart(now) / apart(last), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    } else if (event.shiftKey || event.buttons & 6) move(dx, dy);
    else turn(dx, dy);
    fingers.set(event.pointerId, now);
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  // The wheel scrolls the page until the drawing has been clicked.
  canvas.addEventListener("wheel", (event) => {
    if (document.activeElement !== canvas) return;
    event.preventDefault();
    enlarge(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), event.offsetX, event.offsetY);
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const middle = [canvas.clientWidth / 2, canvas.clientHeight / 2];
    const act = {
      ArrowLeft: () => turn(-20, 0), ArrowRight: () => turn(20, 0), ArrowUp: () => turn(0, -20), ArrowDown: () => turn(0, 20),
      "+": () => enlarge(1.25, ...middle), "=": () => enlarge(1.25, ...middle), "-": () => enlarge(0.8, ...middle),
    }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
  for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => look(button.dataset.view));
  for (const input of document.querySelectorAll("[data-class]")) {
    input.addEventListener("change", () => {
      shown[input.dataset.class] = input.checked;
      ask();
    });
  }
  // A view that nobody has turned or moved fits the new size.
  new ResizeObserver(() => (preset ? look(preset) : ask())).observe(canvas);
  look(preset);
})();
