// SPDX-License-Identifier: LGPL-3.0-or-later
// A quarter of the lower half of a ball on a quarter of a block, hexahedra by transfinite meshing.
// The half ball is an inner block and three that join it to the sphere: below, along x, along y.
// Without a block (block = 0) it is for a scene of its own, against a rigid wall.
DefineConstant[ radius = 0.01 ];   // m, of the ball
DefineConstant[ width = 0.006 ];   // m, of the block, and its height
DefineConstant[ size = 0.00006 ];  // m, edge of the cells at the contact
DefineConstant[ growth = 1.3 ];    // from cell to cell away from it
DefineConstant[ block = 1 ];       // whether there is one

s = 0.78 * radius;   // of the inner block: along its axes, to its edges and to its corner
d = 0.62 * radius;
e = 0.52 * radius;
q = radius / Sqrt(2);
k = radius / Sqrt(3);

// cells along the sphere, from it inwards, of the inner block upwards, and of the block
n_arc = Ceil(Log(1 + Pi / 4 * radius * (growth - 1) / size) / Log(growth));
n_in = Ceil(Log(1 + (radius - s) * (growth - 1) / size) / Log(growth));
n_up = 5;
n_block = Ceil(Log(1 + width * (growth - 1) / size) / Log(growth));

// ball: centre, inner block, sphere
Point(1) = {0, 0, radius};
Point(2) = {s, 0, radius};
Point(3) = {0, s, radius};
Point(4) = {0, 0, radius - s};
Point(5) = {d, d, radius};
Point(6) = {d, 0, radius - d};
Point(7) = {0, d, radius - d};
Point(8) = {e, e, radius - e};
Point(12) = {radius, 0, radius};
Point(13) = {0, radius, radius};
Point(14) = {0, 0, 0};
Point(15) = {q, q, radius};
Point(16) = {q, 0, radius - q};
Point(17) = {0, q, radius - q};
Point(18) = {k, k, radius - k};

// along x and y the cells are finest at the axis, upwards they are equal
Line(1) = {1, 2};
Line(2) = {3, 5};
Line(3) = {4, 6};
Line(4) = {7, 8};
Line(5) = {1, 3};
Line(6) = {2, 5};
Line(7) = {4, 7};
Line(8) = {6, 8};
Line(9) = {4, 1};
Line(10) = {6, 2};
Line(11) = {7, 3};
Line(12) = {8, 5};
Circle(13) = {14, 1, 16};
Circle(14) = {17, 1, 18};
Circle(15) = {13, 1, 15};
Circle(16) = {14, 1, 17};
Circle(17) = {16, 1, 18};
Circle(18) = {12, 1, 15};
Circle(19) = {16, 1, 12};
Circle(20) = {18, 1, 15};
Circle(21) = {17, 1, 13};
Line(22) = {12, 2};   // from the sphere inwards
Line(23) = {13, 3};
Line(24) = {14, 4};
Line(25) = {15, 5};
Line(26) = {16, 6};
Line(27) = {17, 7};
Line(28) = {18, 8};
Transfinite Curve {1 : 8, 13 : 18} = n_arc + 1 Using Progression growth;
Transfinite Curve {9 : 12, 19 : 21} = n_up + 1;
Transfinite Curve {22 : 28} = n_in + 1 Using Progression growth;

// faces of the inner block: bottom, top, at x = 0, at y = 0, towards x, towards y
Curve Loop(1) = {3, 8, -4, -7};    Plane Surface(1) = {1};
Curve Loop(2) = {1, 6, -2, -5};    Plane Surface(2) = {2};
Curve Loop(3) = {9, 5, -11, -7};   Plane Surface(3) = {3};
Curve Loop(4) = {9, 1, -10, -3};   Plane Surface(4) = {4};
Curve Loop(5) = {10, 6, -12, -8};  Surface(5) = {5};
Curve Loop(6) = {11, 2, -12, -4};  Surface(6) = {6};
// the sphere below, along x, along y
Curve Loop(7) = {13, 17, -14, -16};   Surface(7) = {7} In Sphere {1};
Curve Loop(8) = {19, 18, -20, -17};   Surface(8) = {8} In Sphere {1};
Curve Loop(9) = {21, 15, -20, -14};   Surface(9) = {9} In Sphere {1};
// between sphere and inner block: at x = 0, at y = 0, at the top, and within
Curve Loop(10) = {16, 27, -7, -24};   Plane Surface(10) = {10};
Curve Loop(11) = {21, 23, -11, -27};  Plane Surface(11) = {11};
Curve Loop(12) = {13, 26, -3, -24};   Plane Surface(12) = {12};
Curve Loop(13) = {19, 22, -10, -26};  Plane Surface(13) = {13};
Curve Loop(14) = {18, 25, -6, -22};   Plane Surface(14) = {14};
Curve Loop(15) = {15, 25, -2, -23};   Plane Surface(15) = {15};
Curve Loop(16) = {17, 28, -8, -26};   Surface(16) = {16};
Curve Loop(17) = {14, 28, -4, -27};   Surface(17) = {17};
Curve Loop(18) = {20, 25, -12, -28};  Surface(18) = {18};

Surface Loop(1) = {1, 2, 3, 4, 5, 6};       Volume(1) = {1};
Surface Loop(2) = {1, 7, 10, 12, 16, 17};   Volume(2) = {2};
Surface Loop(3) = {5, 8, 13, 14, 16, 18};   Volume(3) = {3};
Surface Loop(4) = {6, 9, 11, 15, 17, 18};   Volume(4) = {4};

// block: its own nodes, so that both bodies are free to part
If (block)
For i In {0 : 1}
  Point(31 + 4 * i) = {0, 0, -i * width};
  Point(32 + 4 * i) = {width, 0, -i * width};
  Point(33 + 4 * i) = {width, width, -i * width};
  Point(34 + 4 * i) = {0, width, -i * width};
  Line(31 + 4 * i) = {31 + 4 * i, 32 + 4 * i};
  Line(32 + 4 * i) = {34 + 4 * i, 33 + 4 * i};
  Line(33 + 4 * i) = {31 + 4 * i, 34 + 4 * i};
  Line(34 + 4 * i) = {32 + 4 * i, 33 + 4 * i};
EndFor
For i In {0 : 3}
  Line(41 + i) = {31 + i, 35 + i};
EndFor
Transfinite Curve {31 : 38, 41 : 44} = n_block + 1 Using Progression growth;
Curve Loop(31) = {31, 34, -32, -33};   Plane Surface(31) = {31};
Curve Loop(32) = {35, 38, -36, -37};   Plane Surface(32) = {32};
Curve Loop(33) = {33, 44, -37, -41};   Plane Surface(33) = {33};
Curve Loop(34) = {31, 42, -35, -41};   Plane Surface(34) = {34};
Curve Loop(35) = {34, 43, -38, -42};   Plane Surface(35) = {35};
Curve Loop(36) = {32, 43, -36, -44};   Plane Surface(36) = {36};
Surface Loop(5) = {31, 32, 33, 34, 35, 36};
Volume(5) = {5};
EndIf

Transfinite Surface "*";
Recombine Surface "*";
Transfinite Volume "*";

Physical Volume("ball") = {1, 2, 3, 4};
Physical Surface("cap") = {7};
Physical Surface("zmax") = {2, 14, 15};
Physical Surface("xmin") = {3, 10, 11};
Physical Surface("ymin") = {4, 12, 13};
If (block)
  Physical Volume("block") = {5};
  Physical Surface("xmin") += {33};
  Physical Surface("ymin") += {34};
  Physical Surface("block_top") = {31};
  Physical Surface("block_bottom") = {32};
EndIf
