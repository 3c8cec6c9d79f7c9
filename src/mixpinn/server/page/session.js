// Record, replay, save, and the picture as a file.

const at = (id) => document.getElementById(id);

export class Session {
  /**
   * @param {import("./link.js").Link} link
   * @param {import("./stage.js").Stage} stage
   */
  constructor(link, stage) {
    this.link = link;
    this.recording = false;
    this.replaying = false;
    this.frames = 0;
    at("record").addEventListener("click", () => this.record());
    at("replay").addEventListener("click", () => this.replay());
    at("save").addEventListener("click", () => link.send({ type: "save", format: at("save-kind").value }));
    at("screenshot").addEventListener("click", async () => {
      download(URL.createObjectURL(await stage.picture()), "mixpinn.png");
    });
    link.addEventListener("recording", ({ detail }) => {
      this.recording = detail.on;
      this.frames = detail.frames;
      this.#show(detail.full ? "full" : "");
    });
    link.addEventListener("replayed", () => {
      this.replaying = false;
      this.#show();
    });
    link.addEventListener("answer", () => {
      if (!this.recording) return;
      this.frames += 1;
      this.#show();
    });
    // A new connection is a new session, without the old one's recording.
    link.addEventListener("open", () => {
      this.recording = this.replaying = false;
      this.frames = 0;
      this.#show();
    });
    link.addEventListener("saved", ({ detail }) => download(detail.url, detail.name));
  }

  record() {
    this.link.send({ type: "record", on: !this.recording });
  }

  replay() {
    if (!this.frames || this.recording) return;
    this.replaying = !this.replaying;
    this.link.send(this.replaying ? { type: "replay" } : { type: "stop" });
    this.#show();
  }

  #show(note = "") {
    const button = at("record");
    button.setAttribute("aria-pressed", String(this.recording));
    button.lastChild.textContent = this.recording ? "Stop" : "Record";
    at("replay").textContent = this.replaying ? "Stop" : "Replay";
    at("replay").disabled = this.recording || !this.frames;
    at("recorded").textContent = note || (this.frames ? `${this.frames}` : "");
    for (const option of at("save-kind").options) option.disabled = option.value !== "vtu" && !this.frames;
  }
}

function download(url, name) {
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  if (url.startsWith("blob:")) setTimeout(() => URL.revokeObjectURL(url), 10_000);
}
