// Everything by keyboard. The list that the page shows stands in index.html.

/**
 * @param {import("./stage.js").Stage} stage
 * @param {import("./probes.js").Probes} probes
 * @param {Record<string, () => void>} commands what single letters start: compare, record, replay, help, second
 */
export function listenToKeys(stage, probes, commands) {
  const { camera, canvas } = stage;
  const view = (move) => { move(); stage.ask(); };
  const add = (name, step) => probes.set({ [name]: probes.current[name] + step });

  const letters = {
    q: () => add("turn", -5), e: () => add("turn", 5),
    a: () => add("tiltRight", -2), d: () => add("tiltRight", 2),
    w: () => add("tiltDown", -2), s: () => add("tiltDown", 2),
    i: () => view(() => camera.orbit(0, 0.08)), k: () => view(() => camera.orbit(0, -0.08)),
    j: () => view(() => camera.orbit(0.08, 0)), l: () => view(() => camera.orbit(-0.08, 0)),
    I: () => view(() => camera.pan(0, 0.05)), K: () => view(() => camera.pan(0, -0.05)),
    J: () => view(() => camera.pan(-0.05, 0)), L: () => view(() => camera.pan(0.05, 0)),
    "+": () => view(() => camera.zoom(0.9)), "=": () => view(() => camera.zoom(0.9)),
    "-": () => view(() => camera.zoom(1 / 0.9)), 0: () => view(() => camera.home()),
    1: () => probes.choose(0), 2: commands.second,
    c: commands.compare, r: commands.record, p: commands.replay, "?": commands.help,
  };
  const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    const inField = event.target.matches("select, input:not([type=range]):not([type=checkbox]):not([type=radio])");
    if (inField) return;
    // Arrows belong to sliders, choices and handles while these have the focus.
    if (event.target === canvas || event.target === document.body) {
      const far = event.shiftKey, move = moves[event.key];
      if (move) probes.step(move[0] * (far ? 10 : 2), move[1] * (far ? 10 : 2));
      else if (event.key === "PageDown") add("depth", far ? 2 : 0.5);
      else if (event.key === "PageUp") add("depth", far ? -2 : -0.5);
      if (move || event.key.startsWith("Page")) {
        event.preventDefault();
        return;
      }
    }
    const act = letters[event.key] ?? (event.shiftKey ? undefined : letters[event.key.toLowerCase()]);
    if (act) {
      event.preventDefault();
      act();
    }
  });
}
