// Browsers start no worker from a file. This runs the script of a worker in a hidden frame instead, so that the search
// works when the built site is opened without a server. Only what the search of the theme uses is here.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.documentElement.append(frame);
      this.scope = frame.contentWindow;
      const base = new URL(url, document.baseURI);
      const load = (source) => new Promise((done, failed) => {
        const script = this.scope.document.createElement("script");
        script.src = new URL(source, base);
        script.onload = done;
        script.onerror = failed;
        this.scope.document.head.append(script);
      });
      this.scope.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      this.scope.importScripts = (...sources) => sources.reduce((last, source) => last.then(() => load(source)), Promise.resolve());
      this.ready = load(base);
    }
    postMessage(data) {
      this.ready.then(() => this.scope.dispatchEvent(new MessageEvent("message", { data })));
    }
    terminate() {}
  };
}
