within InkLoop.Functions;
pure function volumeAreaDrop "Surface and covered area after one drop"
  extends Icons.Function;

  input Types.Height heightBefore[:, :] "Surface, mean over each cell";
  input Types.Share areaBefore[size(heightBefore, 1), size(heightBefore, 2)] "Covered share of each cell";
  input Types.Height substrate[size(heightBefore, 1), size(heightBefore, 2)] "Height of the bare ground";
  input Integer i "Cell that is hit, along x";
  input Integer j "Cell that is hit, along y";
  input Types.Height drop "Volume of this drop over the area of a cell";
  input Types.InverseLength m[4] "Coefficients m_v+, m_v-, m_a+, m_a-";
  input Types.Share cap[2, 3] "Volume and covered shares on flat ground: middle, side, corner";
  input Boolean guard "= true, if a higher cell grows its area at constant height";
  output Types.Height height[size(heightBefore, 1), size(heightBefore, 2)] "Surface after the drop";
  output Types.Share area[size(heightBefore, 1), size(heightBefore, 2)] "Covered share after the drop";

protected
  constant Types.Height FLAT = 1e-15 "Largest height difference that counts as 0";
  Types.Height covered[size(heightBefore, 1), size(heightBefore, 2)] =
    coveredHeight(heightBefore, areaBefore, substrate) "Heights of the covered parts";
  Types.Height difference[3, 3] = zeros(3, 3) "Height differences before the drop";
  Types.Height largest = 0 "Largest amount of them";
  Boolean flat = false "= true, if the ground is flat";
  Types.Height rise = 0 "Height difference of a neighbour";
  Types.Height gained = 0 "Ink that a neighbour gains";
  Types.Height ink = 0 "Ink that it has, over the area of a cell";
  Types.Number grown = 0 "Its covered share after the drop";
  Types.Height left = drop "Ink that is left for the cell that is hit";

algorithm
  (difference, largest) := heightDifference(covered, i, j);
  flat := largest <= FLAT;
  height := heightBefore;
  area := areaBefore;
  for di in -1:1 loop
    for dj in -1:1 loop
      if (di <> 0 or dj <> 0) and isInside(i + di, j + dj, size(height, 1), size(height, 2)) then
        rise := difference[di + 2, dj + 2];
        gained := drop*(if flat then (if di == 0 or dj == 0 then cap[1, 2] else cap[1, 3])
          else (if rise > 0 then m[1] else m[2])*rise);
        grown := areaBefore[i + di, j + dj] + (if flat then (if di == 0 or dj == 0 then cap[2, 2] else cap[2, 3])
          else (if rise > 0 then m[3] else m[4])*rise);
        ink := heightBefore[i + di, j + dj] - substrate[i + di, j + dj];
        if guard and not flat and rise > 0 and ink > 0 and gained > 0 then
          grown := max(grown, areaBefore[i + di, j + dj]*(1 + gained/ink));
        end if;
        height[i + di, j + dj] := heightBefore[i + di, j + dj] + gained;
        area[i + di, j + dj] := max(0, min(1, grown));
        left := left - gained;
      end if;
    end for;
  end for;
  height[i, j] := heightBefore[i, j] + left;
  area[i, j] := if flat then min(1, areaBefore[i, j] + cap[2, 1]) else 1;

  annotation (Documentation(info="<html>
<p>
Equations (10) to (13) of <a href=\"modelica://InkLoop.UsersGuide.References\">[Wu2024]</a>. A neighbour q with the
<a href=\"modelica://InkLoop.Functions.heightDifference\">height difference</a> d before the drop gains the volume share m<sub>v</sub> d and
the area share m<sub>a</sub> d, with one coefficient for d &gt; 0 and another for d &lt; 0; the cell that is hit keeps the rest of the drop and is
covered. On flat ground the drop is a <a href=\"modelica://InkLoop.Functions.capShares\">spherical cap</a>.
</p>
<h4>Assumptions</h4>
<ul>
<li>Ink that would lie outside the grid stays with the cell that is hit, so a drop always adds its volume.</li>
<li>m<sub>a</sub>+ = 0 freezes the area of a partly covered cell that stands above its surroundings, so its height may grow without limit. This follows from the
equations; with <code>guard</code> such a cell grows its area at constant height.</li>
</ul>
</html>"));
end volumeAreaDrop;
