//! How the page looks: light and dark by the reader's setting, and on paper.

/// The style sheet. Colours `--c0` to `--c7` are those of series in plots.
pub const STYLE: &str = "\
:root{color-scheme:light dark;--page:#fcfcfb;--card:#fff;--ink:#1a1a19;--soft:#5f5e5a;--line:#dddcd8;--grid:#ecebe7;--good:#e3f1e1;--warn:#fdf1d8;--warn-line:#c98a14;\
--c0:#2a78d6;--c1:#d1571b;--c2:#15856b;--c3:#a03fb0;--c4:#8a6d00;--c5:#c4314b;--c6:#4b7a1d;--c7:#5a5fc7}\
@media(prefers-color-scheme:dark){:root{--page:#1a1a19;--card:#222220;--ink:#f4f3f0;--soft:#b3b2ad;--line:#3b3a38;--grid:#2d2c2a;--good:#22402a;--warn:#3d3018;--warn-line:#d9a036;\
--c0:#5aa2ee;--c1:#f08a4f;--c2:#3fbf9f;--c3:#d07be0;--c4:#d1b23c;--c5:#f0748a;--c6:#92c25a;--c7:#9a9ef2}}\
*{box-sizing:border-box}\
body{margin:2rem auto;max-width:1180px;padding:0 1rem;background:var(--page);color:var(--ink);font:15px/1.5 system-ui,'Liberation Sans',sans-serif}\
h1{font-size:1.7rem;margin:0 0 .2rem}h2{font-size:1.3rem;margin:2.8rem 0 .3rem;padding-top:.9rem;border-top:2px solid var(--line)}h3{font-size:1rem;margin:1.4rem 0 .4rem}\
p{margin:.2rem 0 .8rem;max-width:105ch}p.soft,.soft{color:var(--soft)}a{color:var(--c0)}\
.figures{display:flex;flex-wrap:wrap;gap:.4rem 2.2rem;margin:1.2rem 0;padding:0}\
.figures div{min-width:5rem}.figures dt{color:var(--soft);font-size:.85rem}.figures dd{margin:0;font-size:1.3rem}\
nav ul{list-style:none;display:flex;flex-wrap:wrap;gap:.2rem 1.2rem;padding:0;margin:.6rem 0 0}\
.warnings{background:var(--warn);border-left:4px solid var(--warn-line);padding:.5rem 1rem;margin:1rem 0;border-radius:3px}.warnings ul{margin:.2rem 0;padding-left:1.1rem}\
.verdict{font-size:1.05rem;max-width:none}\
.charts{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,500px),1fr));gap:0 2.5rem;align-items:start}.charts>section{min-width:0}\
svg{max-width:100%;height:auto;font-size:12px;display:block;overflow:visible}svg text{fill:var(--ink)}svg .tick,svg .axis{fill:var(--soft)}\
svg .grid{stroke:var(--grid)}svg .ground{stroke:var(--soft)}svg .line{fill:none;stroke:var(--c);stroke-width:2;stroke-linejoin:round}svg .mark{fill:var(--c);stroke:var(--page);stroke-width:.7}\
svg .hollow{fill:var(--page);stroke:var(--c);stroke-width:2}svg .origin{stroke:var(--c);stroke-width:1.5;stroke-dasharray:1 4}svg .lead{fill:none;stroke:var(--c);stroke-width:.8;opacity:.55}svg .end{fill:var(--ink)}\
svg .p1 .line{stroke-dasharray:7 4}svg .p2 .line{stroke-dasharray:2 3}\
svg .work{fill:var(--c);stroke:var(--page);stroke-width:1}svg .way{stroke:var(--c);stroke-width:1;opacity:.7}svg .frame{stroke:var(--ink);stroke-width:2}svg .unanswered{stroke:var(--soft);stroke-width:1;opacity:.6}svg .band{fill:var(--grid);opacity:.45}\
.s0{--c:var(--c0)}.s1{--c:var(--c1)}.s2{--c:var(--c2)}.s3{--c:var(--c3)}.s4{--c:var(--c4)}.s5{--c:var(--c5)}.s6{--c:var(--c6)}.s7{--c:var(--c7)}\
.class{white-space:nowrap;margin-right:1em}.swatch{display:inline-block;width:.7em;height:.7em;border-radius:2px;background:var(--c);margin-right:.45em}\
.wide{overflow-x:auto}.wide svg{min-width:760px}.scroll{overflow-x:auto;margin:.3rem 0 .8rem}table{border-collapse:collapse;font-size:.88rem;min-width:100%}caption{text-align:left;color:var(--soft);padding:.2rem 0;font-size:.85rem}\
th,td{padding:.25rem .7rem;text-align:right;border-bottom:1px solid var(--line);font-variant-numeric:tabular-nums;white-space:nowrap}\
th{color:var(--soft);font-weight:500}tbody th{color:var(--ink);font-weight:400}th:first-child,td:first-child{text-align:left;padding-left:0}td.t,th.t{text-align:left}td.t{white-space:normal;overflow-wrap:break-word;min-width:3rem}td.best{background:var(--good);font-weight:600}td.no{color:var(--soft)}\
details{margin:.3rem 0 .8rem}summary{cursor:pointer;color:var(--soft);font-size:.9rem}\
.sheet{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,520px),1fr));gap:1.2rem 1.6rem}figure{margin:0;break-inside:avoid}\
.pair{display:grid;grid-template-columns:1fr 1fr;gap:.4rem}.pair div{min-width:0}.pair img{width:100%;border-radius:3px;display:block;background:var(--line)}.pair span{font-size:.78rem;color:var(--soft)}figcaption{font-size:.85rem;margin-top:.25rem;overflow-wrap:anywhere}\
pre{background:var(--card);border:1px solid var(--line);border-radius:3px;padding:.6rem .8rem;overflow-x:auto;font-size:.82rem;white-space:pre-wrap;overflow-wrap:anywhere}code{font-size:.9em;overflow-wrap:anywhere}\
dl.words{display:grid;grid-template-columns:max-content 1fr;gap:.2rem 1.2rem;font-size:.9rem}dl.words dt{color:var(--soft)}dl.words dd{margin:0;max-width:75ch}\
@media(max-width:640px){dl.words{grid-template-columns:1fr}dl.words dd{margin-bottom:.4rem}.pair{grid-template-columns:1fr}}\
@media print{body{margin:0;max-width:none;font-size:11px}h2{break-after:avoid}section,table,svg{break-inside:avoid}nav{display:none}.scroll,.wide{overflow:visible}.wide svg{min-width:0}details::details-content{content-visibility:visible;block-size:auto}}";
