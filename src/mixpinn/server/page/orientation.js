// Which side of the patient each edge of the picture shows.

import { dot, scale } from "./linear.js";

const SIDES = [
  ["Right", [1, 0, 0]], ["Left", [-1, 0, 0]], ["Posterior", [0, 1, 0]], ["Anterior", [0, -1, 0]],
  ["Caudal", [0, 0, 1]], ["Cranial", [0, 0, -1]],
];

/** Name the four edges of the stage after each picture. */
export function labelEdges(stage) {
  const labels = [...document.querySelectorAll(".edge")];
  stage.addEventListener("drawn", () => {
    const { right, top } = stage.camera;
    const towards = { right, left: scale(right, -1), top, bottom: scale(top, -1) };
    for (const label of labels) {
      const direction = towards[label.dataset.edge];
      const [name] = SIDES.reduce((best, side) => (dot(side[1], direction) > dot(best[1], direction) ? side : best));
      if (label.textContent !== name) label.textContent = name;
    }
  });
}
