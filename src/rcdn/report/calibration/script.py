"""The one script of the page, in parts; without it the page says the same, still.

Copy buttons appear, a picture opens in a dialog (Escape closes it, the arrow keys go on), boards in space turn under the finger or the arrow keys.
"""

COPY = (
    "document.querySelectorAll('button[data-copy]').forEach(function(b){b.hidden=false;b.onclick=function(){"
    "var p=document.getElementById(b.dataset.copy),r=document.createRange(),s=getSelection();r.selectNodeContents(p);"
    "s.removeAllRanges();s.addRange(r);var ok=document.execCommand('copy');b.textContent=ok?'Copied':'Press Ctrl+C'}});"
)
"""Shows the buttons that copy a block of numbers."""

ENLARGE = """
(function(){var links=Array.from(document.querySelectorAll('a.large')),dialog=document.createElement('dialog'),at=0;
if(!links.length||!dialog.showModal)return;dialog.className='views';document.body.append(dialog);
function button(text,act){var b=document.createElement('button');b.textContent=text;b.onclick=act;return b}
function show(k){at=(k+links.length)%links.length;var f=links[at].parentNode.cloneNode(true),a=f.querySelector('a.large'),
bar=document.createElement('div');f.removeAttribute('id');f.querySelectorAll('[id]').forEach(function(e){e.removeAttribute('id')});
a.replaceWith(a.firstElementChild);bar.className='bar';bar.append(button('\u2190 Previous',function(){show(at-1)}),
button('Next \u2192',function(){show(at+1)}),button('Close',function(){dialog.close()}));dialog.replaceChildren(bar,f);
bar.lastChild.focus()}
links.forEach(function(a,k){a.onclick=function(e){if(e.ctrlKey||e.metaKey||e.shiftKey)return;e.preventDefault();dialog.showModal();show(k)}});
dialog.onclick=function(e){if(e.target===dialog)dialog.close()};
dialog.onkeydown=function(e){var step={ArrowLeft:-1,ArrowRight:1}[e.key];if(step){e.preventDefault();show(at+step)}}})();
"""
"""Opens a picture large, in a dialog that the browser closes on Escape."""

SCRIPT = (COPY + ENLARGE).replace("\n", "")
