// The search of the site runs in a worker, which browsers refuse to start from a file on the disk.
// There an invisible frame does the same: it runs the worker's script and hands messages on.
if (location.protocol === 'file:') {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement('iframe');
      frame.hidden = true;
      document.body.append(frame);
      this.inside = frame.contentWindow;
      this.inside.postMessage = (data) => {
        this.dispatchEvent(new MessageEvent('message', { data }));
      };
      const script = frame.contentDocument.createElement('script');
      this.ready = new Promise((resolve) => script.addEventListener('load', resolve));
      script.src = new URL(url, location.href).href;
      frame.contentDocument.body.append(script);
    }

    postMessage(data) {
      this.ready.then(() => {
        this.inside.dispatchEvent(new this.inside.MessageEvent('message', { data }));
      });
    }
  };
}
