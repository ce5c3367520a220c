// Search runs in a worker, which browsers refuse to a page that was opened as a file. There, a hidden frame stands in:
// it runs the worker's script and passes messages both ways.
if (location.protocol === "file:") {
  window.IFrameWorker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.appendChild(frame);
      const inside = frame.contentWindow;
      frame.contentDocument.open();
      frame.contentDocument.write("<!doctype html><title>Search</title>");
      frame.contentDocument.close();
      inside.importScripts = (...addresses) =>
        addresses.reduce((before, address) => before.then(() => this.load(inside, address)), Promise.resolve());
      // The worker's script calls postMessage for what it has to say.
      inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      this.inside = inside;
      this.ready = this.load(inside, url);
    }

    load(inside, address) {
      return new Promise((resolve, reject) => {
        const script = inside.document.createElement("script");
        script.src = address;
        script.onload = resolve;
        script.onerror = reject;
        inside.document.body.appendChild(script);
      });
    }

    postMessage(data) {
      this.ready.then(() => this.inside.dispatchEvent(new MessageEvent("message", { data })));
    }

    terminate() {
      this.inside.frameElement.remove();
    }
  };
  window.Worker = window.IFrameWorker;
}
