// The socket to the station: reconnects with back-off, notices silence, hands out messages.

import { backoff } from './backoff.js';
import { parsePicture, parseText } from './protocol.js';

// The station sends ten messages a second; after so many seconds without one the socket is taken for dead. Seconds are
// counted by a timer, not by a clock: while the page itself is busy, messages wait and the station is not silent.
const SILENT_S = 5;

export class Link {
  // `on` has: open(), closed(), message(object), picture(object).
  constructor(url, on) {
    this.url = url;
    this.on = on;
    this.attempt = 0;
    this.isOpen = false;
    this.retryAt = 0; // performance.now() of the next try
    this.quietSeconds = 0;
    this.unread = 0;
    this.watched = '[]';
    this.connect();
    window.setInterval(() => this.checkSilence(), 1000);
    window.addEventListener('online', () => this.retryNow());
    document.addEventListener('visibilitychange', () => {
      if (!document.hidden) this.retryNow();
    });
  }

  connect() {
    window.clearTimeout(this.timer);
    this.timer = undefined;
    const socket = new WebSocket(this.url);
    socket.binaryType = 'arraybuffer';
    this.socket = socket;
    this.quietSeconds = 0;
    socket.onopen = () => {
      if (socket !== this.socket) return;
      this.isOpen = true;
      this.quietSeconds = 0;
      this.on.open();
      if (this.watched !== '[]') this.sendWatched();
    };
    socket.onmessage = ({ data }) => {
      if (socket === this.socket) this.receive(data);
    };
    socket.onclose = () => {
      if (socket === this.socket) this.lose();
    };
  }

  receive(data) {
    this.quietSeconds = 0;
    const isText = typeof data === 'string';
    const message = isText ? parseText(data) : parsePicture(data);
    if (!message) {
      this.unread += 1;
      return;
    }
    // Only a message is a success: a station that closes at once goes on being retried with back-off.
    this.attempt = 0;
    if (isText) this.on.message(message);
    else this.on.picture(message);
  }

  lose() {
    this.isOpen = false;
    const wait = backoff(this.attempt);
    this.attempt += 1;
    this.retryAt = performance.now() + wait;
    this.timer = window.setTimeout(() => this.connect(), wait);
    this.on.closed();
  }

  checkSilence() {
    this.quietSeconds += 1;
    if (this.timer === undefined && this.quietSeconds > SILENT_S) {
      const { socket } = this;
      this.socket = null; // its late close is no news
      socket.close();
      this.lose();
    }
  }

  retryNow() {
    if (this.timer !== undefined) this.connect();
  }

  // Tells the station whose camera images are wanted; repeated after a reconnection.
  watch(names) {
    const text = JSON.stringify(names);
    if (text === this.watched) return;
    this.watched = text;
    if (this.isOpen) this.sendWatched();
  }

  sendWatched() {
    this.socket.send(`{"type":"watch","camera":${this.watched}}`);
  }
}
