// Puts the page together: scene, picture, connection, controls, numbers.

import { Calm, write } from "./calm.js";
import { Comparison } from "./compare.js";
import { bindProbe, bindView } from "./controls.js";
import { Handles } from "./handles.js";
import { listenToKeys } from "./keys.js";
import { Link } from "./link.js";
import { labelEdges } from "./orientation.js";
import { listenToPointer } from "./pointer.js";
import { Probes } from "./probes.js";
import { Results } from "./results.js";
import { loadScene } from "./scene.js";
import { Session } from "./session.js";
import { Stage } from "./stage.js";
import { followTheme } from "./theme.js";

const at = (id) => document.getElementById(id);
const AGAIN = 2000; // milliseconds until the scene is asked for again
const LATE = 5000; // milliseconds without an answer after which the page says so

function start(scene) {
  at("bundle").textContent = scene.name;
  at("bundle-notes").textContent = scene.warnings.map((text) => `The bundle: ${text}.`).join(" ");
  document.title = `${scene.name} – MIXPINN`;
  const stage = new Stage(at("canvas"), scene), link = new Link(scene.skin.nodes), calm = new Calm();
  const probes = new Probes(stage), results = new Results(scene, probes, calm);
  new Handles(stage, probes);
  labelEdges(stage);
  bindProbe(stage, probes, link, calm);
  const colourBy = bindView(stage);
  stage.addEventListener("inside", ({ detail: seen }) => {
    link.chooseVertices(seen ? "nodes" : "skin");
    if (seen) probes.repeat();
  });
  const session = new Session(link, stage);
  const comparison = new Comparison(link, stage, probes, colourBy);
  listenToPointer(stage, probes);
  listenToKeys(stage, probes, {
    compare: () => comparison.start(), record: () => session.record(), replay: () => session.replay(),
    help: () => at("help").showModal(), second: () => probes.choose(1),
  });
  at("help-open").addEventListener("click", () => at("help").showModal());
  followTheme(() => stage.dress());

  probes.addEventListener("wish", ({ detail }) => link.press(detail, probes.wishes[detail]));
  probes.addEventListener("dismiss", ({ detail }) => link.send({ type: "lift", probe: detail }));
  probes.addEventListener("chosen", () => {
    if (stage.answer) results.show(stage.answer);
    calm.now();
    stage.ask();
  });
  const unknown = at("colour").querySelector("[value=error]");
  link.addEventListener("answer", ({ detail: answer }) => {
    if (comparison.take(answer)) return;
    stage.show(answer); // the numbers follow with the picture: one change of the page costs less than two
    unknown.disabled = !answer.errors;
    say("");
  });
  stage.addEventListener("drawn", () => {
    if (stage.answer) {
      link.shown(stage.answer.poseId);
      results.show(stage.answer);
    }
    calm.drawn();
  });
  link.addEventListener("open", () => {
    tell("open", "Connected");
    say("");
    probes.repeat();
  });
  link.addEventListener("closed", ({ detail }) => {
    tell("closed", "No connection");
    say(`The server cannot be reached${detail.reason ? ` (${detail.reason})` : ""}. Is 'mixpinn view' still running? `
      + "This page comes back by itself when it is.");
  });
  link.addEventListener("error", ({ detail }) => say(plain(detail)));
  setInterval(() => {
    if (link.isOpen && link.owed > LATE) {
      say("The server is connected but has not answered for some seconds. It may be busy; the very first answer of a "
        + "new installation takes a while.");
    }
    const { rate } = stage.pace, { answer } = stage;
    const facts = rate > 1 ? [`${rate} pictures/s`] : [];
    if (answer) facts.push(`answer in ${answer.solveMs.toFixed(0)} ms`);
    write(at("rate"), facts.join(" · "));
  }, 500);
  link.connect();
  return { stage, probes, link };
}

function tell(state, text) {
  at("status").dataset.state = state;
  at("status").textContent = text;
}

function say(text) {
  if (at("notice").hidden !== !text) at("notice").hidden = !text;
  write(at("notice"), text);
}

/** An error of the server for people who did not write the message it answers. */
function plain({ what, got, fix }) {
  return `${what}: ${got}. To mend it: ${fix}.`;
}

async function open() {
  try {
    // Scripts that drive the page find it here.
    window.mixpinn = start(await loadScene());
  } catch (error) {
    tell("closed", "Not ready");
    say(error instanceof TypeError ? "The server cannot be reached. This page tries again." : error.message);
    if (error instanceof TypeError) setTimeout(open, AGAIN);
  }
}

open();
