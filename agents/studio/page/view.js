// The world from above on a canvas: metres with y up or with the chair's heading up, on any screen.
const FARTHEST = 12; // times the size at which all is seen
const NAMES = [
  "floor", "unknown", "wall", "goal", "laser", "ultrasonic", "chair", "person", "door", "sudden", "furniture", "trail", "track",
  "asked", "given", "start", "text", "alarm", "accent", "veil", "path", ...Array.from({ length: 8 }, (_, k) => `series-${k}`),
];

export class View {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {function} redraw called when the picture has to be drawn anew
   * @param {function} pans whether a press of the mouse moves the picture
   */
  constructor(canvas, redraw, pans = () => true) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.redraw = redraw;
    this.bounds = [0, 0, 10, 10];
    this.zoom = 1;
    this.angle = 0; // by which the world is turned on the screen [rad]
    this.shift = [0, 0]; // of the world to the right and up [m]
    this.centre = null; // that is followed [m]; null: the middle of the world
    this.watch = new ResizeObserver(() => { this.fit(); redraw(); });
    this.watch.observe(canvas);
    this.restyle();
    this.listen(pans);
  }

  close() { this.watch.disconnect(); }

  restyle() {
    const style = getComputedStyle(document.documentElement);
    this.colour = Object.fromEntries(NAMES.map(name => [name, style.getPropertyValue(`--${name}`).trim()]));
  }

  /** The mouse drags, wheel and two fingers zoom; one finger scrolls the page. */
  listen(pans) {
    const canvas = this.canvas, between = ([a, b]) => Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
    const amid = ([a, b]) => ({ clientX: (a.clientX + b.clientX) / 2, clientY: (a.clientY + b.clientY) / 2 });
    let held = null, apart = 0;
    canvas.addEventListener("wheel", event => {
      if (event.deltaY > 0 && this.zoom <= 1) return; // all is seen: the page scrolls
      event.preventDefault();
      this.zoomTo(this.zoom * Math.exp(-0.002 * event.deltaY), event);
    }, { passive: false });
    canvas.addEventListener("touchstart", event => {
      if (event.touches.length !== 2) return;
      held = amid(event.touches);
      apart = between(event.touches);
    }, { passive: true });
    canvas.addEventListener("touchmove", event => {
      if (event.touches.length !== 2) return;
      event.preventDefault();
      const now = amid(event.touches), far = between(event.touches);
      this.drag(held, now);
      this.zoomTo(this.zoom * far / apart, now);
      held = now;
      apart = far;
    }, { passive: false });
    canvas.addEventListener("pointerdown", event => {
      if (event.pointerType === "touch" || !pans(event)) return;
      canvas.setPointerCapture(event.pointerId);
      held = event;
    });
    canvas.addEventListener("pointermove", event => {
      if (event.pointerType === "touch" || !held || !canvas.hasPointerCapture(event.pointerId)) return;
      this.drag(held, event);
      held = event;
    });
    canvas.addEventListener("lostpointercapture", () => { held = null; });
  }

  drag(from, to) {
    const ratio = this.canvas.width / this.canvas.clientWidth / this.scale;
    this.shift = [this.shift[0] + (to.clientX - from.clientX) * ratio, this.shift[1] - (to.clientY - from.clientY) * ratio];
    this.redraw();
  }

  /** Zoom; what lies at an event stays there. */
  zoomTo(zoom, event) {
    const before = event && this.place(event);
    this.zoom = Math.min(FARTHEST, Math.max(1, zoom));
    this.fit();
    if (this.zoom === 1) this.shift = [0, 0];
    else if (event) {
      const [x, y] = this.place(event), [right, up] = turned([x - before[0], y - before[1]], this.angle);
      this.shift = [this.shift[0] + right, this.shift[1] + up];
    }
    this.redraw();
  }

  fit() {
    const ratio = devicePixelRatio || 1, [x0, y0, x1, y1] = this.bounds;
    const width = Math.max(1, Math.round(this.canvas.clientWidth * ratio)), height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
    this.scale = this.zoom * Math.min(width / (x1 - x0 + 0.6), height / (y1 - y0 + 0.6));
    this.pixel = ratio / this.scale;
  }

  /** The place [m] in the middle of the picture. */
  middle() {
    const [x0, y0, x1, y1] = this.bounds, [dx, dy] = turned(this.shift, -this.angle);
    const [x, y] = (this.zoom > 1 || this.angle) && this.centre ? this.centre : [(x0 + x1) / 2, (y0 + y1) / 2];
    return [x - dx, y - dy];
  }

  /** The place [m] of a pointer's event. */
  place(event) {
    const box = this.canvas.getBoundingClientRect(), ratio = this.canvas.width / box.width, [x, y] = this.middle();
    const right = ((event.clientX - box.left) * ratio - this.canvas.width / 2) / this.scale;
    const [dx, dy] = turned([right, (this.canvas.height / 2 - (event.clientY - box.top) * ratio) / this.scale], -this.angle);
    return [x + dx, y + dy];
  }

  /** Clear, and draw from now on in metres. */
  begin() {
    this.fit();
    const c = this.context, [x, y] = this.middle();
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.fillStyle = this.colour.unknown;
    c.fillRect(0, 0, this.canvas.width, this.canvas.height);
    c.setTransform(this.scale, 0, 0, -this.scale, this.canvas.width / 2, this.canvas.height / 2);
    c.rotate(this.angle);
    c.translate(-x, -y);
    c.lineJoin = c.lineCap = "round";
  }

  /** Draw the scale bar and, where north is not up, an arrow to it. */
  end() {
    const c = this.context, ratio = devicePixelRatio || 1, { width, height } = this.canvas, wanted = 0.2 * width / this.scale;
    const power = 10 ** Math.floor(Math.log10(wanted)), length = power * [5, 2, 1].find(one => one * power <= wanted * (1 + 1e-9));
    const long = length * this.scale, label = `${Number(length.toPrecision(1))} m`, y = height - 12 * ratio;
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.font = `600 ${13 * ratio}px system-ui, sans-serif`;
    c.textBaseline = "middle";
    const words = c.measureText(label).width, left = 12 * ratio;
    c.globalAlpha = 0.85; c.fillStyle = this.colour.floor;
    c.fillRect(left - 6 * ratio, y - 11 * ratio, long + words + 20 * ratio, 22 * ratio);
    c.globalAlpha = 1; c.fillStyle = c.strokeStyle = this.colour.text; c.lineWidth = 1.5 * ratio;
    const tick = 4 * ratio;
    c.beginPath();
    for (const [ax, ay, bx, by] of [[0, 0, long, 0], [0, -tick, 0, tick], [long, -tick, long, tick]]) {
      c.moveTo(left + ax, y + ay); c.lineTo(left + bx, y + by);
    }
    c.stroke();
    c.fillText(label, left + long + 8 * ratio, y);
    if (!this.angle) return;
    c.translate(22 * ratio, 26 * ratio);
    c.rotate(-this.angle); // the canvas turns clockwise
    c.beginPath();
    for (const [ax, ay] of [[0, -16], [7, 4], [0, 0], [-7, 4]]) c.lineTo(ax * ratio, ay * ratio);
    c.fill();
    c.fillText("N", -5 * ratio, 13 * ratio);
  }

  /** Fill what a function traces, and draw its rim. */
  shape(trace, fill, rim = null, width = 2, alpha = 1) {
    const c = this.context;
    c.beginPath();
    trace(c);
    if (fill) { c.globalAlpha = alpha; c.fillStyle = fill; c.fill("evenodd"); c.globalAlpha = 1; }
    if (rim) { c.strokeStyle = rim; c.lineWidth = width * this.pixel; c.stroke(); }
  }

  segments(rows, colour, width = 2) {
    this.shape(c => { for (const [x0, y0, x1, y1] of rows) { c.moveTo(x0, y0); c.lineTo(x1, y1); } }, null, colour, width);
  }

  line(points, colour, width = 2, dash = []) {
    this.context.setLineDash(dash.map(one => one * this.pixel));
    this.shape(c => points.forEach(([x, y]) => c.lineTo(x, y)), null, colour, width);
    this.context.setLineDash([]);
  }

  disc(x, y, radius, fill, rim = null, width = 2, alpha = 1) {
    this.shape(c => c.arc(x, y, radius, 0, 2 * Math.PI), fill, rim, width, alpha);
  }

  polygon(points, fill, rim = null, width = 2, alpha = 1) {
    this.shape(c => { points.forEach(([x, y]) => c.lineTo(x, y)); c.closePath(); }, fill, rim, width, alpha);
  }

  dots(points, colour, size = 3) {
    const c = this.context, side = size * this.pixel;
    c.fillStyle = colour;
    for (const [x, y] of points) c.fillRect(x - side / 2, y - side / 2, side, side);
  }

  arrow(x, y, dx, dy, colour, width = 3) {
    const size = Math.hypot(dx, dy);
    if (size < 0.02) return;
    const ux = dx / size, uy = dy / size, tip = Math.min(0.18, size * 0.6);
    this.segments([[x, y, x + dx, y + dy]], colour, width);
    this.line([[x + dx - tip * (ux - 0.6 * uy), y + dy - tip * (uy + 0.6 * ux)], [x + dx, y + dy],
      [x + dx - tip * (ux + 0.6 * uy), y + dy - tip * (uy - 0.6 * ux)]], colour, width);
  }
}

const turned = ([x, y], by) => [x * Math.cos(by) - y * Math.sin(by), x * Math.sin(by) + y * Math.cos(by)];

/** A point of the chair's frame, or of anything's, on the map. */
export const placed = ([x, y, yaw], point) => {
  const [dx, dy] = turned(point, yaw);
  return [x + dx, y + dy];
};

/** Floor, walls and round things. */
export function drawWorld(view, world) {
  const c = view.context, [x0, y0, x1, y1] = world.bounds;
  c.fillStyle = view.colour.floor;
  c.fillRect(x0, y0, x1 - x0, y1 - y0);
  if (!world.traced) {
    world.traced = new Path2D();
    for (const loop of world.solids) {
      loop.forEach(([x, y], k) => (k ? world.traced.lineTo(x, y) : world.traced.moveTo(x, y)));
      world.traced.closePath();
    }
  }
  c.fillStyle = view.colour.wall;
  c.fill(world.traced, "evenodd");
  view.segments(world.walls ?? [], view.colour.wall, 1);
  for (const [x, y, r] of world.discs ?? []) view.disc(x, y, r, view.colour.wall);
}

export function drawGoal(view, [x, y], tolerance) {
  const { goal } = view.colour, radius = Math.max(tolerance, 0.1);
  view.disc(x, y, radius, goal, goal, 2.5, 0.22);
  view.disc(x, y, 0.08, goal);
}

/** Who moves: people and round things as discs, doors and furniture as boxes. */
export function drawActors(view, kinds, poses) {
  const { person, door, furniture, sudden, text } = view.colour, fills = { person, door, furniture };
  poses.forEach((pose, k) => {
    if (pose[0] === null || !kinds[k]) return;
    const [kind, length, width] = kinds[k], fill = fills[kind] ?? sudden, rim = kind === "door" ? fill : text;
    if (width === 0) {
      view.disc(pose[0], pose[1], length, fill, rim);
      return;
    }
    const front = kind === "door" ? length : length / 2, rear = front - length, half = width / 2;
    view.polygon([[rear, -half], [front, -half], [front, half], [rear, half]].map(one => placed(pose, one)), fill, rim, 1.5);
  });
}

const HEADING = [[0.92, 0], [0.45, 0.42], [0.56, 0], [0.45, -0.42]]; // of front and half width

/** The chair with its heading, and what was asked and given as arrows. */
export function drawChair(view, world, now) {
  const { chair, alarm, floor, asked, given } = view.colour, colour = now.contact ? alarm : chair;
  const front = Math.max(...world.outline.map(one => one[0])), half = Math.max(...world.outline.map(one => one[1]));
  view.polygon(world.outline.map(one => placed(now.pose, one)), colour, colour, 2.5, 0.6);
  view.polygon(HEADING.map(([ahead, left]) => placed(now.pose, [ahead * front, left * half])), floor);
  const [forward, , turn] = world.limits, [x, y, yaw] = now.pose;
  for (const [[v, w], hue] of [[[now.stick[0] * forward, now.stick[1] * turn], asked], [now.given, given]]) {
    view.arrow(x, y, ...turned([1.2 * v / forward, 0.8 * w / turn], yaw), hue);
  }
}

const SECTORS = 64; // of the scan, each of which is noticed or not
const FAR = 1000; // m

/** Cover what a person does not see: beyond an angle to either side, and sectors beyond the angle of neglect. */
export function drawVeil(view, world, now) {
  if (!now.sight) return;
  const [left, right, neglect, unnoticed] = now.sight, c = view.context, [mx, my, turn, fov] = world.laser, first = turn - fov / 2;
  const wedge = ([x, y], from, to) => {
    if (to <= from) return;
    c.moveTo(x, y); c.arc(x, y, FAR, now.pose[2] + from, now.pose[2] + to); c.closePath();
  };
  c.save();
  c.fillStyle = view.colour.veil;
  c.beginPath(); wedge(now.pose, left, Math.PI); wedge(now.pose, -Math.PI, -right); c.fill();
  c.beginPath(); wedge(now.pose, neglect, Math.PI); c.clip();
  const mount = placed(now.pose, [mx, my]), each = fov / SECTORS;
  c.beginPath();
  for (const k of unnoticed) wedge(mount, first + k * each, first + (k + 1) * each + 0.002); // without a seam between two
  wedge(mount, first + fov, first + 2 * Math.PI); // behind the scanner nothing is noticed
  c.fill();
  c.restore();
}

/** The scan and the cones of the ultrasonics. */
export function drawSenses(view, world, now, ranges) {
  const [x, y, yaw, fov, beams, reach] = world.laser, { laser, ultrasonic } = view.colour;
  const mount = placed(now.pose, [x, y]), first = now.pose[2] + yaw - fov / 2;
  const fan = Array.from(ranges, (range, k) => {
    const angle = first + (fov * k) / Math.max(1, beams - 1), near = Math.max(ranges[k - 1] || 0, ranges[k + 1] || 0); // a lone lost echo makes no spike
    const metres = (range || near) / 1000 || reach;
    return [mount[0] + metres * Math.cos(angle), mount[1] + metres * Math.sin(angle)];
  });
  view.polygon([mount, ...fan], laser, null, 0, 0.1);
  view.dots(fan.filter((_, k) => ranges[k]), laser);
  world.cones.forEach(([cx, cy, turn, angle], k) => {
    const range = now.sonar[k], at = now.pose[2] + turn;
    if (range === null || range > 2.5) return;
    const [ux, uy] = placed(now.pose, [cx, cy]), trace = c => { c.moveTo(ux, uy); c.arc(ux, uy, range, at - angle / 2, at + angle / 2); c.closePath(); };
    view.shape(trace, ultrasonic, ultrasonic, 1, 0.3);
  });
}
