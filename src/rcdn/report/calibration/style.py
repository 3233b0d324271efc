"""The style sheet of the report, and its content security policy."""

from __future__ import annotations

import base64
import hashlib

from rcdn.report.calibration.script import SCRIPT

SHEET = """
:root{color-scheme:light dark;--paper:#f6f7f9;--card:#fff;--ink:#1a1f26;--soft:#55606d;--line:#d9dee5;--faint:#eceff3;
--accent:#0b62c4;--good:#1a7a3c;--fair:#8a5a00;--unsure:#a8480f;--bad:#c22f2f;--good-bg:#e8f5ec;--fair-bg:#fdf3dc;--unsure-bg:#fdeee0;--bad-bg:#fdeaea;
--heat:#b3401f;--frame:#fbfcfd}
@media (prefers-color-scheme:dark){:root{--paper:#0f1318;--card:#171c23;--ink:#e8ecf1;--soft:#a3adb9;--line:#303842;--faint:#222932;
--accent:#74b5ff;--good:#5fca82;--fair:#e5b04a;--unsure:#ffa060;--bad:#ff8a80;--good-bg:#13281b;--fair-bg:#2c2412;--unsure-bg:#302012;--bad-bg:#331a1b;
--heat:#ff8d5c;--frame:#12171d}}
*{box-sizing:border-box}
html{-webkit-text-size-adjust:100%;scroll-behavior:smooth}
body{margin:0;background:var(--paper);color:var(--ink);font:16px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"Noto Sans",
"Liberation Sans",Arial,sans-serif;font-variant-numeric:tabular-nums}
main,header,footer{max-width:1160px;margin:0 auto;padding:0 24px}
header{padding-top:32px}
h1{font-size:1.65rem;line-height:1.25;margin:0 0 4px;letter-spacing:-.01em;overflow-wrap:anywhere}
h2{font-size:1.25rem;line-height:1.3;margin:48px 0 6px;letter-spacing:-.005em}
h3,h4{font-size:1rem;line-height:1.35;margin:0 0 2px}
p{margin:0 0 8px;max-width:75ch}
a{color:var(--accent);text-underline-offset:2px}
:focus-visible{outline:3px solid var(--accent);outline-offset:2px}
.soft,figcaption,caption,.lead{color:var(--soft)}
.lead{margin-bottom:16px}
bdi,code{overflow-wrap:anywhere}
code,pre{font-family:ui-monospace,SFMono-Regular,Menlo,Consolas,"Liberation Mono",monospace;font-size:.875rem}
nav ul{list-style:none;display:flex;flex-wrap:wrap;gap:4px 18px;padding:0;margin:14px 0 18px;font-size:.9375rem}
.card{background:var(--card);border:1px solid var(--line);border-radius:12px;padding:18px 20px;margin:0}
.two{display:grid;grid-template-columns:repeat(2,minmax(0,1fr));gap:20px;align-items:stretch}
.two>*{min-width:0}
.two+.two,.card+.card,.two+.card,.card+.two{margin-top:20px}
.two>.card+.card{margin-top:0}.column{display:flex;flex-direction:column;gap:20px}.column>.card+.card{margin-top:0}.loose{align-items:start}
.verdict{border-left:8px solid var(--tone);background:var(--tint);padding:22px 24px}
.good{--tone:var(--good);--tint:var(--good-bg)}.fair{--tone:var(--fair);--tint:var(--fair-bg)}.unsure{--tone:var(--unsure);--tint:var(--unsure-bg)}
.bad{--tone:var(--bad);--tint:var(--bad-bg)}
.verdict .top{display:flex;gap:16px;align-items:center}
.verdict .top svg{width:52px;height:52px;flex:none}
.verdict h2{margin:0;font-size:1.75rem;color:var(--tone);line-height:1.2}
.verdict .top p{margin:2px 0 0}
.verdict .summary{margin:14px 0 0;max-width:95ch}
.sign{width:20px;height:20px;flex:none}
.sign,.top svg{color:var(--tone)}
.reasons{list-style:none;margin:0;padding:0;display:grid;grid-template-columns:repeat(2,minmax(0,1fr));column-gap:40px}
.reasons li{display:flex;gap:10px;padding:11px 0;border-top:1px solid var(--line)}
.reasons li:nth-child(-n+2){border-top:0}
.reasons .sign{margin-top:2px}
.reasons div{flex:1;min-width:0}
.reasons .head{display:flex;justify-content:space-between;gap:12px;font-weight:600}
.reasons .head span:last-child{white-space:nowrap}
.reasons p{margin:0;font-size:.9375rem;color:var(--soft)}
.why-limit{font-weight:400;max-width:60ch}
.advice{margin:4px 0 0;padding-left:1.3em}.advice li{margin:4px 0;max-width:85ch}
.key{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:1px;background:var(--line);border:1px solid var(--line);
border-radius:12px;overflow:hidden;margin:20px 0 0}
.key div{background:var(--card);padding:13px 16px}
.key dt{font-size:.875rem;color:var(--soft)}
.key dd{margin:0;font-size:1.25rem;font-weight:600;line-height:1.35;overflow-wrap:anywhere}
.key dd small{display:block;font-size:.875rem;font-weight:400;color:var(--soft)}
.wide{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-size:.9375rem}
caption{text-align:left;padding-bottom:6px;font-size:.9375rem}
th,td{text-align:left;padding:6px 14px 6px 0;border-top:1px solid var(--line);vertical-align:top}
tr>:last-child{padding-right:0}
thead th{border-top:0;color:var(--soft);font-weight:600;font-size:.875rem}
th[scope=row]{font-weight:600}
td.n,th.n{text-align:right;white-space:nowrap}
tr.chosen th,tr.chosen td{font-weight:600}
.tag{display:inline-block;font-size:.8125rem;font-weight:600;border:1px solid currentColor;border-radius:99px;padding:0 8px;
color:var(--accent);white-space:nowrap}
.tag.out{color:var(--bad)}
pre{margin:8px 0 0;padding:12px 14px;background:var(--faint);border-radius:8px;overflow-x:auto;line-height:1.5;tab-size:2}
.copyhead{display:flex;justify-content:space-between;align-items:center;gap:12px}
button{font:inherit;font-size:.875rem;color:var(--ink);background:var(--card);border:1px solid var(--line);border-radius:8px;
padding:4px 14px;min-height:32px;cursor:pointer}
button:hover{border-color:var(--accent);color:var(--accent)}
figure{margin:0}
figure .plot{display:block;width:100%;height:auto;margin:10px auto 8px;overflow:visible}
figcaption{font-size:.9375rem}
.plot text{font:11px system-ui,-apple-system,"Segoe UI",Roboto,"Noto Sans","Liberation Sans",Arial,sans-serif;fill:var(--soft)}
.plot text.strong{fill:var(--ink);font-weight:600}
.plot text.halo{paint-order:stroke;stroke:var(--card);stroke-width:4px;stroke-linejoin:round}
.plot .sensor{fill:var(--frame);stroke:var(--soft);stroke-width:1}
.plot .axis{stroke:var(--soft);stroke-width:1;fill:none}
.plot .grid{stroke:var(--line);stroke-width:1;fill:none}
.plot .dot{stroke:var(--accent);stroke-linecap:round;fill:none}
.plot .line{stroke:var(--accent);fill:none}
.plot .mean{stroke:var(--ink);stroke-width:2;fill:none;stroke-linejoin:round}
.plot .band{fill:var(--heat);fill-opacity:.22}
.plot .bar{fill:var(--accent);fill-opacity:.88}
.plot .bar.worse{fill:var(--fair)}
.plot .bar.right{fill-opacity:.55}
.plot .bar.out{fill:none;stroke:var(--bad);stroke-dasharray:3 2}
.plot .cross{stroke:var(--bad);stroke-width:1.6;fill:none}
.plot .rule{stroke:var(--ink);stroke-width:1;stroke-dasharray:5 4}
.plot .hatch{stroke:var(--bad);stroke-width:1.2;stroke-opacity:.6}
.plot .blind{fill:var(--line)}
.plot .broken{fill:var(--bad);fill-opacity:.32}
.plot .board{fill:var(--accent);fill-opacity:.05;stroke:var(--accent);stroke-width:1.1;stroke-linejoin:round}
.plot .board.faint{fill-opacity:.03;stroke-opacity:.28;stroke-width:.8}
.plot .unsure{fill:none;stroke:var(--heat);stroke-width:1}.plot .ray.weak{stroke:var(--heat)}
.plot .board.out{fill:none;stroke:var(--bad);stroke-dasharray:4 3}
.plot .board.next{fill:var(--good);fill-opacity:.3;stroke:var(--good);stroke-width:2}
.plot .suggested{stroke:var(--good);stroke-width:1;stroke-linejoin:round}
.plot .suggested.light{fill:var(--good);fill-opacity:.1}.plot .suggested.dark{fill:var(--good);fill-opacity:.75}
.plot a:hover .board,.plot a:focus .board{fill-opacity:.45;stroke-width:2}
.plot .ray{fill:none;stroke:var(--ink);stroke-width:1.4;stroke-linejoin:round}
.plot.space{touch-action:pan-y;cursor:grab;overflow:hidden}
.plot .contour{fill:none;stroke:var(--ink);stroke-opacity:.55;stroke-width:.8}
.plot .systematic{stroke:var(--bad)}
.plot .heat{fill:var(--heat)}
.plot .heatline{stroke:var(--heat);fill:none}
.plot .plate{fill:var(--card);fill-opacity:.86}
.legend{display:flex;flex-wrap:wrap;gap:4px 16px;list-style:none;margin:0 0 8px;padding:0;font-size:.875rem;color:var(--soft)}
.legend li{display:flex;align-items:center;gap:6px}
.legend svg{width:18px;height:14px;flex:none}
.shots{display:grid;grid-template-columns:repeat(auto-fill,minmax(240px,1fr));gap:18px 16px;margin-top:12px}
.shot{min-width:0}
.tall{max-height:520px;overflow:auto}
.names{margin:6px 0 8px}
.views h3,.views h4{margin:18px 0 2px;font-size:1rem}
.views h3{margin-top:22px}
figure .frame{margin:10px 0}.shot .frame{margin:0}
.frame{position:relative;background:#2b3138;border-radius:6px;overflow:hidden}
.frame img{display:block;width:100%;height:auto}
.frame svg{position:absolute;inset:0;width:100%;height:100%;overflow:hidden}
.shot.out .frame{outline:3px solid var(--bad);outline-offset:-1px}
.shot figcaption{font-size:.875rem;margin-top:5px;line-height:1.4}
.shot figcaption div{display:flex;justify-content:space-between;gap:8px}
.shot strong{color:var(--ink)}
.why{color:var(--bad)}
.halo2{stroke:#000;stroke-opacity:.75}
.u{stroke:#4be37c}.o{stroke:#ff5c4d}.l{stroke:#ffc14d}.c{stroke:#ffd84d}.h{stroke:#46c8ff}
.frame path,.frame use{fill:none;stroke-linecap:round;vector-effect:non-scaling-stroke}
.large{display:block;cursor:zoom-in}.back,.shot figcaption .more{display:none}
.shot:target figcaption .more,dialog .shot figcaption .more{display:block}
.shot:target{position:fixed;inset:0;z-index:2;overflow:auto;background:var(--paper);padding:16px}.shot:target .back{display:block}
.shot:target .frame,dialog .shot .frame{width:min(100%,calc(var(--ratio)*(100vh - 190px)));margin:0 auto}
.shot:target .large{cursor:auto}
.shot:target .u,dialog .u{stroke-width:5px;filter:drop-shadow(0 0 1px #000)}
dialog{width:min(96vw,1800px);max-width:none;max-height:none;border:1px solid var(--line);border-radius:12px;background:var(--card);color:var(--ink);
padding:12px 16px}
dialog::backdrop{background:rgba(0,0,0,.7)}
dialog .bar{display:flex;flex-wrap:wrap;gap:8px;margin-bottom:10px}dialog .bar button:last-child{margin-left:auto}
dialog .shot figcaption{max-width:900px;margin:8px auto 0}
details{margin-top:12px}
summary{cursor:pointer;color:var(--accent);padding:4px 0}
dl.words{display:grid;grid-template-columns:minmax(150px,220px) 1fr;gap:8px 24px;margin:12px 0 0;font-size:.9375rem}
dl.words dt{font-weight:600}dl.words dd{margin:0;color:var(--soft);max-width:80ch}
footer{padding-top:28px;padding-bottom:40px;color:var(--soft);font-size:.875rem}
.sr{position:absolute;width:1px;height:1px;overflow:hidden;clip-path:inset(50%);white-space:nowrap}
@media screen and (max-width:760px){
main,header,footer{padding-left:16px;padding-right:16px}header{padding-top:20px}
.two,.reasons{grid-template-columns:minmax(0,1fr)}
.reasons li:nth-child(2){border-top:1px solid var(--line)}
.card{padding:15px 15px}.verdict{padding:18px 16px}.verdict h2{font-size:1.45rem}
.verdict .top{gap:12px}.verdict .top svg{width:42px;height:42px}
h1{font-size:1.4rem}h2{margin-top:38px}
.plot text{font-size:15px}pre{font-size:.78rem;padding:10px 12px}
.shots{grid-template-columns:repeat(2,minmax(0,1fr));gap:14px 10px}
.key{grid-template-columns:repeat(2,minmax(0,1fr))}.key dd{font-size:1.125rem}
dl.words{grid-template-columns:1fr;gap:2px}dl.words dd{margin-bottom:10px}
th,td{padding-right:10px}
}
@media print{
:root{--paper:#fff;--card:#fff;--ink:#000;--soft:#444;--line:#bbb;--faint:#f3f3f3;--accent:#0b4fa0;--good:#14632f;--fair:#7a4f00;
--unsure:#8f3a08;--bad:#a82020;--good-bg:#fff;--fair-bg:#fff;--unsure-bg:#fff;--bad-bg:#fff;--heat:#b3401f;--frame:#fff;color-scheme:light}
body{font-size:10.5pt}nav,button{display:none!important}main,header,footer{max-width:none;padding-left:0;padding-right:0}
*{-webkit-print-color-adjust:exact;print-color-adjust:exact}
.card,.shot,.reasons li,tr{break-inside:avoid}h2,h3{break-after:avoid}.shots{grid-template-columns:repeat(4,1fr)}
.tall{max-height:none}details::details-content{content-visibility:visible}a{color:inherit;text-decoration:none}
}
"""

POLICY = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; "
    f"script-src 'sha256-{base64.b64encode(hashlib.sha256(SCRIPT.encode()).digest()).decode()}'"
)
"""The content security policy: embedded pictures only, and no script except SCRIPT."""
