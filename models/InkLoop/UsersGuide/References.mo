within InkLoop.UsersGuide;
class References "References"
  extends Icons.Information;

  annotation (
    DocumentationClass=true,
    Documentation(info="<html>
<dl>
<dt>[Lu2015]</dt>
<dd>L. Lu, J. Zheng, S. Mishra, \"A layer-to-layer model and feedback control of ink-jet 3-D printing\", IEEE/ASME Transactions on
Mechatronics 20 (2015), doi:10.1109/TMECH.2014.2366123.</dd>
<dt>[Wu2024]</dt>
<dd>Y. Wu, G. Chiu, \"An improved height difference based model of height profile for drop-on-demand 3D printing with UV curable
ink\", 2024.</dd>
<dt>[Salmon2011]</dt>
<dd>J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, \"Parallel random numbers: as easy as 1, 2, 3\", SC '11 (2011),
doi:10.1145/2063384.2063405.</dd>
</dl>
</html>"));
end References;
