// Runs in every browser: hides the warning in those that have what the page needs.
(function () {
  var enough = 'noModule' in document.createElement('script') && typeof DecompressionStream === 'function' && 'WebSocket' in window;
  document.documentElement.className = enough ? 'ready' : 'unsupported';
})();
