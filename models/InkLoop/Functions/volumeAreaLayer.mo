within InkLoop.Functions;
pure function volumeAreaLayer "Surface and covered area after one layer, drop by drop"
  extends Icons.Function;

  input Types.Height heightBefore[:, :] "Surface, mean over each cell";
  input Types.Share areaBefore[size(heightBefore, 1), size(heightBefore, 2)] "Covered share of each cell";
  input Types.Height substrate[size(heightBefore, 1), size(heightBefore, 2)] "Height of the bare ground";
  input Types.Pattern pattern[size(heightBefore, 1), size(heightBefore, 2)] "Pattern to jet";
  input Types.VolumeFactor factor[size(heightBefore, 1), size(heightBefore, 2)] "Volumes of the drops";
  input Types.Height height_scale "Volume of a nominal drop over the area of a cell";
  input Types.InverseLength m[4] "Coefficients m_v+, m_v-, m_a+, m_a-";
  input Types.Share cap[2, 3] "Volume and covered shares on flat ground: middle, side, corner";
  input Boolean guard "= true, if a higher cell grows its area at constant height";
  output Types.Height height[size(heightBefore, 1), size(heightBefore, 2)] "Surface after the layer";
  output Types.Share area[size(heightBefore, 1), size(heightBefore, 2)] "Covered share after the layer";

algorithm
  height := heightBefore;
  area := areaBefore;
  for i in 1:size(heightBefore, 1) loop
    for j in 1:size(heightBefore, 2) loop
      if pattern[i, j] > 0 then
        (height, area) := volumeAreaDrop(height, area, substrate, i, j, factor[i, j]*height_scale, m, cap, guard);
      end if;
    end for;
  end for;

  annotation (Documentation(info="<html>
<p>
The drops fall one after the other, along y first, each on what the last one left. The surface depends on that order.
</p>
</html>"));
end volumeAreaLayer;
