// Interactive grasps. The plotting library and the scenes lie compressed in the page; both are read, and the library is
// run, when the first view is seen. Geometry is stored once, every view places it.
"use strict";
(function () {
  let data; // of all scenes
  const alive = []; // views with a WebGL context, oldest first; browsers allow about sixteen
  const MOST_ALIVE = 6;

  function webgl() {
    try {
      const canvas = document.createElement("canvas");
      return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
    } catch (error) {
      return false;
    }
  }

  let reading; // promise of library and scenes
  function ready() {
    reading ??= Promise.all([embedded("plotly-source"), embedded("scene-data")]).then(([source, scenes]) => {
      const script = document.createElement("script");
      script.textContent = source;
      document.head.appendChild(script);
      data = scenes;
    });
    return reading;
  }

  function mesh(shape, pose, colour, name) {
    const scale = data.unit, x = [], y = [], z = [];
    const v = shape.vertices;
    for (let i = 0; i < v.length; i += 3) {
      const a = v[i] * scale, b = v[i + 1] * scale, c = v[i + 2] * scale;
      x.push(pose[0] * a + pose[1] * b + pose[2] * c + pose[3]);
      y.push(pose[4] * a + pose[5] * b + pose[6] * c + pose[7]);
      z.push(pose[8] * a + pose[9] * b + pose[10] * c + pose[11]);
    }
    const i = [], j = [], k = [], f = shape.faces;
    for (let n = 0; n < f.length; n += 3) { i.push(f[n]); j.push(f[n + 1]); k.push(f[n + 2]); }
    return {
      type: "mesh3d", x, y, z, i, j, k, color: colour, name, hoverinfo: "name", flatshading: true,
      // By default the library takes triangles smaller than 1e-6 square units, square metres here, for degenerate.
      lighting: {
        ambient: 0.45, diffuse: 0.6, specular: 0.1, roughness: 0.8, facenormalsepsilon: 0, vertexnormalsepsilon: 0,
      },
      lightposition: { x: 2000, y: 3000, z: 4000 },
    };
  }

  function traces(grasp) {
    return grasp.bodies.map((body) => mesh(data.shapes[body.shape], body.pose, body.colour, body.name));
  }

  const axis = { visible: false, showspikes: false };
  function layout() {
    return {
      margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, paper_bgcolor: "#fafbfb",
      hoverlabel: { namelength: -1 },
      scene: {
        aspectmode: "data", xaxis: axis, yaxis: axis, zaxis: axis, dragmode: "orbit",
        camera: { eye: { x: 1.35, y: 0.75, z: 0.35 }, up: { x: 0, y: 0, z: 1 } },
      },
    };
  }

  function visible(view) {
    const box = view.getBoundingClientRect();
    return box.bottom > 0 && box.top < window.innerHeight;
  }

  // Frees a context for one more view; views that are seen keep theirs.
  function makeRoom() {
    if (alive.length < MOST_ALIVE) return true;
    const hidden = alive.findIndex((view) => !visible(view));
    if (hidden < 0) return false;
    const scene = alive.splice(hidden, 1)[0].querySelector(".scene");
    window.Plotly.purge(scene);
    scene.remove();
    return true;
  }

  function draw(view) {
    const grasps = data.pairs[view.dataset.pair];
    let scene = view.querySelector(".scene");
    if (!scene) {
      if (!makeRoom()) return;
      scene = document.createElement("div");
      scene.className = "scene";
      view.appendChild(scene);
      alive.push(view);
    }
    const select = view.parentElement.querySelector("select");
    // Named one by one: among the library's own choice is a button that uploads the chart.
    const buttons = [["orbitRotation", "zoom3d", "pan3d", "resetCameraDefault3d"]];
    const options = { displaylogo: false, responsive: true, modeBarButtons: buttons, plotlyServerURL: "" };
    window.Plotly.react(scene, traces(grasps[Number(select.value)]), layout(), options);
  }

  const views = Array.from(document.querySelectorAll(".view[data-pair]"));
  if (!views.length) return;
  if (!webgl()) {
    for (const view of views) {
      view.parentElement.querySelector(".under").textContent = "Turning in 3D needs WebGL, which this browser does not offer.";
    }
    return;
  }
  let waiting = false;
  async function look() {
    waiting = false;
    if (!views.some(visible)) return;
    await ready();
    for (const view of views) if (visible(view) && !view.querySelector(".scene")) draw(view);
  }
  function lookSoon() {
    if (!waiting) { waiting = true; setTimeout(look, 150); }
  }
  window.addEventListener("scroll", lookSoon, { passive: true });
  window.addEventListener("resize", lookSoon);
  lookSoon();
  for (const view of views) view.parentElement.querySelector("select").addEventListener("change", () => ready().then(() => draw(view)));
})();
