within InkLoop.Types;
type Pattern = Integer (min=0, max=2) "Pattern value of a cell: 0 none, 1 material A, 2 material B"
  annotation (Documentation(info="<html><p>0 none, 1 material A, 2 material B.</p></html>"));
