within InkLoop.Functions;
pure function volumeFactors "Volumes of the droplets of a layer, over their nominal volume"
  extends Icons.Function;

  input Integer nx "Cells along x";
  input Integer ny "Cells along y";
  input Integer layer "Number of the layer, from 1";
  input Integer seed "Seed of all random factors";
  input Types.Share variation "Amplitude p of the factor 1 - U[0, p]";
  input Types.VariationKind kind "Scope of one factor";
  input Integer nozzle_pitch "Number of nozzles";
  input Types.Share nozzle_variation "Amplitude of the factor of a nozzle";
  output Types.VolumeFactor factor[nx, ny] "One factor for each cell";

protected
  Integer cell = 0 "Number of the cell, counted from 0 along y first";
  Types.VolumeFactor nozzleFactor[nozzle_pitch] = ones(nozzle_pitch) "One factor for each nozzle";

algorithm
  factor := fill(1.0, nx, ny);
  if variation > 0 then
    for i in 1:nx loop
      for j in 1:ny loop
        cell := (i - 1)*ny + j - 1;
        if kind == Types.VariationKind.per_droplet then
          factor[i, j] := factor[i, j]*(1 - variation*Random.uniform(seed, Random.Stream.droplet, cell, layer));
        end if;
        if kind == Types.VariationKind.per_cell or kind == Types.VariationKind.per_cell_and_layer then
          factor[i, j] := factor[i, j]*(1 - variation*Random.uniform(seed, Random.Stream.cell, cell, 0));
        end if;
      end for;
    end for;
    if kind == Types.VariationKind.per_layer or kind == Types.VariationKind.per_cell_and_layer then
      factor := factor*(1 - variation*Random.uniform(seed, Random.Stream.layer, 0, layer));
    end if;
  end if;
  if nozzle_variation > 0 then
    for k in 1:nozzle_pitch loop
      nozzleFactor[k] := 1 - nozzle_variation*Random.uniform(seed, Random.Stream.nozzle, k - 1, 0);
    end for;
    for j in 1:ny loop
      factor[:, j] := factor[:, j]*nozzleFactor[mod(j - 1, nozzle_pitch) + 1];
    end for;
  end if;

  annotation (Documentation(info="<html>
<p>
A droplet lacks a random part of its volume: its factor is 1 - U[0, p], uniform, as in section VI of
<a href=\"modelica://InkLoop.UsersGuide.References\">[Lu2015]</a>. Each nozzle may have its own factor, the same for the whole print; the head
travels along x, so nozzle number j modulo <code>nozzle_pitch</code> jets on column j, both counted from 0.
</p>
<h4>Assumptions</h4>
<ul>
<li>The numbers equal those of the FMU: <a href=\"modelica://InkLoop.Functions.Random\">Random</a> gives the same bits.</li>
</ul>
</html>"));
end volumeFactors;
