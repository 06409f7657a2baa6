// From above, north up: home, vehicle, target, fence, paths, and how long a metre is.

const LEAST_M = 24, MARGIN_PX = 14;

export class SceneMap {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.scene = null;
    this.isWide = false;
    canvas.addEventListener("click", () => {
      this.isWide = !this.isWide;
      this.draw();
    });
  }

  show(scene) {
    this.scene = scene;
    this.draw();
  }

  draw() {
    const { canvas, context: c, scene } = this;
    const dpr = window.devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = canvas;
    if (!width || !height) return;
    Object.assign(canvas, { width: Math.round(width * dpr), height: Math.round(height * dpr) });
    c.setTransform(dpr, 0, 0, dpr, 0, 0);
    c.clearRect(0, 0, width, height);
    if (!scene) return;
    const { middle, scale } = this.view(width, height);
    this.at = ([north, east]) => [width / 2 + (east - middle[1]) * scale, height / 2 - (north - middle[0]) * scale];
    this.fence(scene.fence, scale);
    this.path(scene.target_path_m, "#ffb400", [3, 3]);
    this.path(scene.vehicle_path_m, "#9fdcff", []);
    this.home();
    if (scene.vehicle_m && scene.target_m) this.line([scene.vehicle_m, scene.target_m], "rgba(255,255,255,.5)", [2, 3]);
    if (scene.target_m) this.target(scene.target_m);
    if (scene.vehicle_m) this.vehicle(scene.vehicle_m, scene.yaw_rad);
    this.north(width);
    this.scaleBar(height, scale);
  }

  /** What is in view: what flies and what is followed; wide: the whole fence. */
  view(width, height) {
    const { scene, isWide } = this;
    const points = [[0, 0], scene.vehicle_m, scene.target_m, ...(scene.vehicle_path_m ?? []), ...(scene.target_path_m ?? [])].filter(Boolean);
    if (isWide && scene.fence) {
      const { north_m: n, east_m: e, radius_m: r, polygon_m } = scene.fence;
      if (polygon_m?.length) points.push(...polygon_m);
      else points.push([n - r, e - r], [n + r, e + r]);
    }
    const [low, high] = [Math.min, Math.max].map((end) => [0, 1].map((axis) => end(...points.map((point) => point[axis]))));
    const middle = [0, 1].map((axis) => (low[axis] + high[axis]) / 2);
    const scale = Math.min(
      (height - 2 * MARGIN_PX) / Math.max(LEAST_M, high[0] - low[0]),
      (width - 2 * MARGIN_PX) / Math.max(LEAST_M, high[1] - low[1]),
    );
    return { middle, scale };
  }

  line(points, colour, dash, width = 1.5) {
    const { context: c } = this;
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.setLineDash(dash);
    c.beginPath();
    for (const point of points) c.lineTo(...this.at(point));
    c.stroke();
    c.setLineDash([]);
  }

  path(points, colour, dash) {
    if (points?.length > 1) this.line(points, colour, dash);
  }

  fence(fence, scale) {
    if (!fence) return;
    this.circle([fence.north_m, fence.east_m], fence.radius_m * scale, "#ff8a80", [6, 4]);
    if (fence.operator_distance_m) this.circle(fence.operator_m, fence.operator_distance_m * scale, "#ff8a80", [2, 4]);
    if (fence.polygon_m?.length) this.line([...fence.polygon_m, fence.polygon_m[0]], "#ff8a80", [], 2);
  }

  circle(point, radius, colour, dash) {
    const { context: c } = this;
    c.strokeStyle = colour;
    c.lineWidth = 2;
    c.setLineDash(dash);
    c.beginPath();
    c.arc(...this.at(point), radius, 0, 2 * Math.PI);
    c.stroke();
    c.setLineDash([]);
  }

  home() {
    const { context: c } = this;
    const [x, y] = this.at([0, 0]);
    c.fillStyle = "#fff";
    c.beginPath();
    c.arc(x, y, 7, 0, 2 * Math.PI);
    c.fill();
    this.text("H", x, y + 0.5, "center", "#000");
  }

  target(point) {
    const { context: c } = this;
    const [x, y] = this.at(point);
    c.strokeStyle = "#ffb400";
    c.lineWidth = 2.5;
    c.strokeRect(x - 5, y - 5, 10, 10);
    c.fillStyle = "#ffb400";
    c.fillRect(x - 1.5, y - 1.5, 3, 3);
  }

  vehicle(point, yaw_rad) {
    const { context: c } = this;
    const [x, y] = this.at(point);
    c.save();
    c.translate(x, y);
    c.rotate(yaw_rad);
    c.beginPath();
    for (const corner of [[0, -10], [7, 8], [0, 4], [-7, 8]]) c.lineTo(...corner);
    c.closePath();
    c.fillStyle = "#3ce6ff";
    c.strokeStyle = "#000";
    c.lineWidth = 1.5;
    c.fill();
    c.stroke();
    c.restore();
  }

  north(width) {
    const { context: c } = this;
    c.fillStyle = "#fff";
    c.beginPath();
    for (const corner of [[width - 12, 6], [width - 7, 16], [width - 17, 16]]) c.lineTo(...corner);
    c.fill();
    this.text("N", width - 12, 23, "center", "#fff");
  }

  scaleBar(height, scale) {
    const { context: c } = this;
    const most = 60 / scale, decade = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].find((step) => step * decade <= most) * decade;
    c.fillStyle = "rgba(0,0,0,.8)"; // a path may lie there
    c.fillRect(4, height - 18, length * scale + 42, 16);
    c.strokeStyle = "#fff";
    c.lineWidth = 2;
    c.beginPath();
    c.moveTo(8, height - 12);
    for (const [x, y] of [[8, -8], [8 + length * scale, -8], [8 + length * scale, -12]]) c.lineTo(x, height + y);
    c.stroke();
    this.text(`${length} m`, 12 + length * scale, height - 10, "left", "#fff");
  }

  text(text, x, y, align, colour) {
    Object.assign(this.context, { font: "bold 11px system-ui, sans-serif", textAlign: align, textBaseline: "middle", fillStyle: colour });
    this.context.fillText(text, x, y);
  }
}
