// A browser starts no worker for a page that was opened as a file. What the search's worker would do is done in a
// frame instead, which has a window of its own; messages go to and from it as to and from a worker.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(address) {
      super();
      this.waiting = [];
      const frame = document.createElement("iframe");
      frame.hidden = true;
      frame.title = "Search";
      document.body.append(frame);
      this.inside = frame.contentWindow;
      this.inside.postMessage = (data) => this.tell(this, data);
      const script = frame.contentDocument.createElement("script");
      script.src = address;
      script.onload = () => {
        this.ready = true;
        this.waiting.forEach((data) => this.tell(this.inside, data));
      };
      frame.contentDocument.body.append(script);
    }

    postMessage(data) {
      this.ready ? this.tell(this.inside, data) : this.waiting.push(data);
    }

    tell(target, data) {
      setTimeout(() => {
        const event = new MessageEvent("message", { data });
        target.dispatchEvent(event);
        target === this && this.onmessage?.(event);
      });
    }
  };
}
