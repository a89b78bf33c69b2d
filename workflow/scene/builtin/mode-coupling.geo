// SPDX-License-Identifier: LGPL-3.0-or-later
// A block of 20 x 5 x 5 mm in two cells, turned by the angle of the wall in mode-coupling.toml.
DefineConstant[ size = 0.01 ]; // m, of the cells along the block
s = 0.22975292054736118;
c = 0.9732489894677301;
For k In {0 : 1}
  For j In {0 : 1}
    For i In {0 : 1}
      x = (2 * i - 1) * 0.01;
      z = (2 * k - 1) * 0.0025;
      Point(1 + i + 2 * j + 4 * k) = {c * x + s * z, (2 * j - 1) * 0.0025, c * z - s * x};
    EndFor
  EndFor
EndFor
Line(1) = {1, 2};   Line(2) = {3, 4};   Line(3) = {5, 6};   Line(4) = {7, 8};
Line(5) = {1, 3};   Line(6) = {2, 4};   Line(7) = {5, 7};   Line(8) = {6, 8};
Line(9) = {1, 5};   Line(10) = {2, 6};  Line(11) = {3, 7};  Line(12) = {4, 8};
Transfinite Curve {1 : 4} = Ceil(0.02 / size - 0.001) + 1;
Transfinite Curve {5 : 12} = 2;
Curve Loop(1) = {1, 6, -2, -5};    Plane Surface(1) = {1};
Curve Loop(2) = {3, 8, -4, -7};    Plane Surface(2) = {2};
Curve Loop(3) = {1, 10, -3, -9};   Plane Surface(3) = {3};
Curve Loop(4) = {2, 12, -4, -11};  Plane Surface(4) = {4};
Curve Loop(5) = {5, 11, -7, -9};   Plane Surface(5) = {5};
Curve Loop(6) = {6, 12, -8, -10};  Plane Surface(6) = {6};
Surface Loop(1) = {1, 2, 3, 4, 5, 6};
Volume(1) = {1};
Transfinite Surface "*";
Recombine Surface "*";
Transfinite Volume "*";

Physical Volume("block") = {1};
Physical Surface("sole") = {1};
Physical Surface("top") = {2};
Physical Surface("side") = {3};
