// Pages opened from disk may not start a worker, and the search runs in one: there a hidden frame takes its place.
if (location.protocol === "file:") {
  window.IFrameWorker = class extends EventTarget {
    constructor(url) {
      super()
      const frame = document.createElement("iframe")
      frame.hidden = true
      document.body.append(frame)
      const inner = frame.contentWindow
      inner.postMessage = data => this.dispatchEvent(new MessageEvent("message", { data }))
      const script = inner.document.createElement("script")
      this.send = new Promise((resolve, reject) => {
        script.onload = () => resolve(data => inner.dispatchEvent(new MessageEvent("message", { data })))
        script.onerror = reject
      })
      script.src = url
      inner.document.head.append(script)
    }

    postMessage(data) {
      this.send.then(send => send(data))
    }
  }
  window.Worker = window.IFrameWorker
}
