within InkLoop.Functions;
pure function dropletShares "Heights that a droplet adds to its cell and to its eight neighbours"
  extends Icons.Function;

  input Types.Height rise[3, 3] "Height of the cell that is hit, less those of its neighbours";
  input Types.Height h[3] "Heights h1, h2, h3 of this droplet";
  output Types.Height share[3, 3] "Added heights; [2, 2] belongs to the cell that is hit";

protected
  Types.Height spread = 0 "Flow to the neighbour on a flat surface";
  Types.Height taken = 0 "Share that it takes";
  Types.Height kept = 0 "Flow back";

algorithm
  share := zeros(3, 3);
  for di in -1:1 loop
    for dj in -1:1 loop
      if di <> 0 or dj <> 0 then
        spread := if di == 0 or dj == 0 then h[2] else h[3];
        taken := spread*saturation(rise[di + 2, dj + 2], h[1] + spread);
        share[di + 2, dj + 2] := taken;
        kept := kept + (spread - taken);
      end if;
    end for;
  end for;
  share[2, 2] := h[1] + kept;

  annotation (Documentation(info="<html>
<p>
Equations (3) to (7) of <a href=\"modelica://InkLoop.UsersGuide.References\">[Lu2015]</a>. For each neighbour q of the cell p that is hit,
with a = h2 (side) or h3 (corner),
</p>
<blockquote><p>
s = sat<sub>h1+a</sub>(H<sub>p</sub> - H<sub>q</sub>),&nbsp; q receives a s,&nbsp; p gets back a (1 - s),
</p></blockquote>
<p>and p receives h1 itself. The shares always add up to h1 + 4 h2 + 4 h3.</p>
</html>"));
end dropletShares;
