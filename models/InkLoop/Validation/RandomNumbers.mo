within InkLoop.Validation;
model RandomNumbers "Known answers of Philox 4x32-10"
  extends Icons.Example;

  constant Functions.Random.Word ONES = 4294967295.0 "2^32 - 1";
  parameter Functions.Random.Word zerosAnswer[4] = Functions.Random.philox({0, 0}, {0, 0, 0, 0}) "Key and counter all zeros";
  parameter Functions.Random.Word onesAnswer[4] = Functions.Random.philox({ONES, ONES}, {ONES, ONES, ONES, ONES}) "Key and counter all ones";

equation
  when time >= 0.5 then
    assert(max(abs(zerosAnswer - {1713891541.0, 3781805453.0, 3159862348.0, 2600524760.0})) < 0.5, "zeros: not 6627e8d5 e169c58d bc57ac4c 9b00dbd8");
    assert(max(abs(onesAnswer - {1083123565.0, 1103641358.0, 2718681030.0, 1834242557.0})) < 0.5, "ones: not 408f276d 41c83b0e a20bc7c6 6d5451fd");
  end when;

  annotation (
    experiment(StopTime=1, Tolerance=1e-6, Interval=0.5),
    Documentation(info="<html>
<p>Two of the known answers that are published with the generator of <a href=\"modelica://InkLoop.UsersGuide.References\">[Salmon2011]</a>.</p>
</html>"));
end RandomNumbers;
