// Sliders, choices and buttons of the left panel, kept in step with what mouse and keys do.

import { write } from "./calm.js";
import { gradient } from "./colours.js";
import { LIMITS } from "./probes.js";

const at = (id) => document.getElementById(id);
const TITLES = { displacement: "Displacement [mm]", error: "Expected error [mm]", difference: "Difference [mm]" };
const SLIDERS = { depth: "depth", spin: "turn", "tilt-right": "tiltRight", "tilt-down": "tiltDown" };

/**
 * @param {import("./stage.js").Stage} stage
 * @param {import("./probes.js").Probes} probes
 * @param {import("./link.js").Link} link
 * @param {import("./calm.js").Calm} calm
 */
export function bindProbe(stage, probes, link, calm) {
  const show = () => {
    for (const [id, name] of Object.entries(SLIDERS)) {
      const value = probes.current[name];
      if (Number(at(id).value) !== value) at(id).value = value;
      write(at(`${id}-value`), name === "depth" ? `${value.toFixed(1)} mm` : `${value.toFixed(0)}°`);
    }
    at("probe-1").checked = probes.active === 0;
    at("probe-2").checked = probes.active === 1;
    at("probe-2").disabled = probes.wishes.length < 2;
    at("second").checked = probes.wishes.length > 1;
  };
  LIMITS.depth[1] = Math.ceil(1.2 * stage.scene.deepest);
  [at("depth").min, at("depth").max] = LIMITS.depth;
  for (const [id, name] of Object.entries(SLIDERS)) {
    at(id).addEventListener("input", () => probes.set({ [name]: Number(at(id).value) }));
  }
  at("lift").addEventListener("click", () => probes.set({ depth: Math.min(0, probes.current.depth) }));
  at("straight").addEventListener("click", () => probes.set({ turn: 0, tiltRight: 0, tiltDown: 0 }));
  at("probe-1").addEventListener("change", () => probes.choose(0));
  at("probe-2").addEventListener("change", () => probes.choose(1));
  at("second").addEventListener("change", () => (at("second").checked ? probes.choose(1) : probes.dismiss()));
  at("friction").addEventListener("change", () => {
    link.chooseFriction(at("friction").checked ? "remembered" : "straight");
    probes.repeat();
  });
  probes.addEventListener("wish", () => calm.ask(probes, show));
  probes.addEventListener("chosen", show);
  show();
}

/**
 * @param {import("./stage.js").Stage} stage
 * @returns {(name: string) => void} sets what the skin is coloured by
 */
export function bindView(stage) {
  const { camera, cut } = stage;
  const colourBy = (name) => {
    at("colour").value = name;
    stage.colourBy(name);
    at("legend").hidden = name === "none";
    if (name === "none") return;
    at("legend-title").textContent = TITLES[name];
    at("legend-bar").style.background = gradient(name);
  };
  at("colour").addEventListener("change", () => colourBy(at("colour").value));

  at("skin").addEventListener("input", () => {
    stage.opacity = Number(at("skin").value) / 100;
    at("skin-value").textContent = `${at("skin").value} %`;
    stage.ask();
  });
  at("skin-value").textContent = `${at("skin").value} %`;

  const showCut = () => {
    cut.kind = at("cut").value;
    cut.share = Number(at("cut-at").value) / 100;
    at("cut-at").disabled = cut.kind === "none";
    at("cut-value").textContent = cut.kind === "none" ? "" : `${Math.round(cut.at) || 0} mm`;
    stage.slice();
  };
  at("cut").addEventListener("change", showCut);
  at("cut-at").addEventListener("input", showCut);

  const looks = {
    home: () => camera.home(), side: () => camera.side(), "zoom-in": () => camera.zoom(0.85),
    "zoom-out": () => camera.zoom(1 / 0.85),
  };
  for (const [id, look] of Object.entries(looks)) {
    at(id).addEventListener("click", () => {
      look();
      stage.ask();
    });
  }

  let shown = -1;
  stage.addEventListener("drawn", () => {
    if (!stage.range || stage.range === shown || stage.colour === "none") return;
    shown = stage.range;
    at("legend-ticks").replaceChildren(...[0, 0.5, 1].map((share) => {
      const tick = document.createElement("span");
      tick.textContent = String(Number((share * shown).toPrecision(3)));
      return tick;
    }));
  });
  colourBy(stage.colour);
  return colourBy;
}
