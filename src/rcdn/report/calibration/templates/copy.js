// Shows the buttons that copy a block of numbers.
document.querySelectorAll("button[data-copy]").forEach(function (b) {
  b.hidden = false;
  b.onclick = function () {
    var p = document.getElementById(b.dataset.copy),
      r = document.createRange(),
      s = getSelection();
    r.selectNodeContents(p);
    s.removeAllRanges();
    s.addRange(r);
    var ok = document.execCommand("copy");
    b.textContent = ok ? "Copied" : "Press Ctrl+C";
  };
});
