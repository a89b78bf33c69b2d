// SPDX-License-Identifier: LGPL-3.0-or-later
// A quarter of a round bar along x from the origin: a square about the axis and two cells around
// it, swept along the bar.
DefineConstant[ radius = 0.0032 ];   // m
DefineConstant[ length = 0.0324 ];   // m
DefineConstant[ size = 0.0008 ];     // m, edge of the cells

n = Ceil(radius / 2 / size);
s = 0.5 * radius;          // of the square: along the axes, and to its corner
d = 0.42 * radius;
q = radius / Sqrt(2);

Point(1) = {0, 0, 0};
Point(2) = {0, s, 0};
Point(3) = {0, d, d};
Point(4) = {0, 0, s};
Point(5) = {0, radius, 0};
Point(6) = {0, q, q};
Point(7) = {0, 0, radius};

Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 1};
Line(5) = {2, 5};
Line(6) = {3, 6};
Line(7) = {4, 7};
Circle(8) = {5, 1, 6};
Circle(9) = {6, 1, 7};
Transfinite Curve {1 : 9} = n + 1;

Curve Loop(1) = {1, 2, 3, 4};     Plane Surface(1) = {1};
Curve Loop(2) = {5, 8, -6, -2};   Plane Surface(2) = {2};
Curve Loop(3) = {6, 9, -7, -3};   Plane Surface(3) = {3};
Transfinite Surface {1 : 3};
Recombine Surface {1 : 3};

one[] = Extrude {length, 0, 0} { Surface{1}; Layers{Ceil(length / size)}; Recombine; };
two[] = Extrude {length, 0, 0} { Surface{2}; Layers{Ceil(length / size)}; Recombine; };
three[] = Extrude {length, 0, 0} { Surface{3}; Layers{Ceil(length / size)}; Recombine; };

// what is made by an extrusion: the far end, the volume, then a surface for each curve in order
Physical Volume("bar") = {one[1], two[1], three[1]};
Physical Surface("face") = {1, 2, 3};
Physical Surface("end") = {one[0], two[0], three[0]};
Physical Surface("ymin") = {one[5], three[4]};
Physical Surface("zmin") = {one[2], two[2]};
