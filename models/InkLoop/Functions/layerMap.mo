within InkLoop.Functions;
pure function layerMap "Surface after one pass of droplets"
  extends Icons.Function;

  input Types.Height height[:, :] "Surface before the pass";
  input Types.Pattern pattern[size(height, 1), size(height, 2)] "Pattern to jet";
  input Types.VolumeFactor factor[size(height, 1), size(height, 2)] "Volumes of the droplets";
  input Types.Ink ink_a "Material A";
  input Types.Ink ink_b "Material B";
  input Types.Height lostBefore = 0 "Heights that have left the grid before";
  output Types.Height after[size(height, 1), size(height, 2)] "Surface after the pass";
  output Types.Height lost "Sum of the heights that have left the grid over its open edges";

protected
  Types.Height rise[3, 3] = zeros(3, 3) "Height of the cell that is hit, less those of its neighbours; 0 beyond the edges";
  Types.Height share[3, 3] = zeros(3, 3) "Heights that one droplet adds";

algorithm
  after := height;
  lost := lostBefore;
  for i in 1:size(height, 1) loop
    for j in 1:size(height, 2) loop
      if pattern[i, j] > 0 then
        for di in -1:1 loop
          for dj in -1:1 loop
            rise[di + 2, dj + 2] := if isInside(i + di, j + dj, size(height, 1), size(height, 2))
              then height[i, j] - height[i + di, j + dj] else 0;
          end for;
        end for;
        share := dropletShares(rise, factor[i, j]*(if pattern[i, j] == 1
          then {ink_a.h1, ink_a.h2, ink_a.h3} else {ink_b.h1, ink_b.h2, ink_b.h3}));
        for di in -1:1 loop
          for dj in -1:1 loop
            if isInside(i + di, j + dj, size(height, 1), size(height, 2)) then
              after[i + di, j + dj] := after[i + di, j + dj] + share[di + 2, dj + 2];
            else
              lost := lost + share[di + 2, dj + 2];
            end if;
          end for;
        end for;
      end if;
    end for;
  end for;

  annotation (Documentation(info="<html>
<p>
The layer-to-layer map of <a href=\"modelica://InkLoop.UsersGuide.References\">[Lu2015]</a>: the
<a href=\"modelica://InkLoop.Functions.dropletShares\">shares</a> of all droplets add up.
</p>
<h4>Assumptions</h4>
<ul>
<li>All droplets of a pass fall on the surface before the pass: they are jetted before any of them is cured.</li>
<li>The grid has open edges: a neighbour outside takes its whole share, as on level ground, and this ink is lost.</li>
<li>With two materials the heights and the width of the saturation are those of the droplet that falls.</li>
<li>A volume factor scales the three heights of a droplet together.</li>
</ul>
</html>"));
end layerMap;
