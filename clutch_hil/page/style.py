"""Style of a page: light, for a screen and for A4."""

STYLE = """
:root{--ink:#1c1c1c;--soft:#5b626b;--line:#dde1e6;--before:#c8402f;--after:#1f6fb4}
*{box-sizing:border-box}
body{font:15.5px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"DejaVu Sans",sans-serif;color:var(--ink);background:#fff;
 max-width:64rem;margin:0 auto;padding:2rem 1.5rem 4rem;overflow-wrap:break-word}
h1{font-size:1.55rem;line-height:1.25;margin:0 0 .2rem}
h2{font-size:1.2rem;margin:2.8rem 0 .6rem;padding-top:.6rem;border-top:1px solid var(--line)}
h3{font-size:1rem;margin:1.5rem 0 .4rem}
p{margin:.5rem 0;max-width:52rem}.soft,figcaption,.meta{color:var(--soft)}.meta{margin-bottom:1.2rem}
.verdict{font-size:1.15rem;line-height:1.45;padding:.9rem 1.1rem;border-left:6px solid var(--mark);background:var(--tint);
 max-width:none;margin:1rem 0}
.nothing_missing{--mark:#2b8a4b;--tint:#eef7f1}.named{--mark:#1f6fb4;--tint:#eef4fa}
.one_of{--mark:#b7791f;--tint:#fcf6e8}.none_of_these{--mark:#b03a48;--tint:#fbf0f1}
.identify_first{--mark:#6b4fa0;--tint:#f4f1f9}
.facts{display:flex;flex-wrap:wrap;gap:.6rem;margin:1rem 0;padding:0;list-style:none}
.facts li{flex:1 1 10rem;border:1px solid var(--line);border-radius:6px;padding:.55rem .8rem;font-size:.86rem;color:var(--soft)}
.facts b{display:block;font-size:1.2rem;color:var(--ink);font-weight:600}
figure{margin:1rem 0 1.2rem}img{display:block;max-width:100%;height:auto}figcaption{font-size:.87rem;margin-top:.35rem;
 max-width:52rem}
.wide{overflow-x:auto;margin:.7rem 0}table{border-collapse:collapse;font-size:.88rem;font-variant-numeric:tabular-nums}
th,td{text-align:left;vertical-align:top;padding:.28rem .9rem .28rem 0;border-bottom:1px solid var(--line)}
th{font-weight:600;color:var(--soft);white-space:nowrap}td.n,th.n{text-align:right;white-space:nowrap}
tr.chosen td{background:#eef4fa;font-weight:600}tr.alike td{background:#f6f9fc}
td.hash{font:.76rem/1.4 ui-monospace,"DejaVu Sans Mono",monospace;word-break:break-all;min-width:13rem;max-width:31rem}
pre{font:.9rem/1.5 ui-monospace,"DejaVu Sans Mono",monospace;background:#f6f7f9;border:1px solid var(--line);border-radius:6px;
 padding:.7rem .9rem;white-space:pre-wrap;overflow-wrap:anywhere}
code{font:.9em ui-monospace,"DejaVu Sans Mono",monospace}
dl{display:grid;grid-template-columns:max-content minmax(0,1fr);gap:.2rem 1.1rem;margin:.6rem 0}dt{color:var(--soft)}
dd{margin:0}dl dl{margin:0}
details{margin:.7rem 0}summary{cursor:pointer;color:var(--soft)}
.before{color:var(--before)}.after{color:var(--after)}
@media screen and (max-width:40rem){figure{overflow-x:auto}figure img{max-width:none;width:44rem}}
@page{size:A4;margin:14mm}
@media print{body{font-size:10pt;padding:0;max-width:none}h1{font-size:15pt}h2{font-size:12.5pt;margin-top:1.4rem}
 h2,h3{break-after:avoid}figure,tr,pre,.verdict,.facts{break-inside:avoid}thead{display:table-header-group}
 .wide{overflow:visible}table{font-size:8.5pt}details::details-content{content-visibility:visible;height:auto}
 summary{list-style:none}*{-webkit-print-color-adjust:exact;print-color-adjust:exact}}
"""
