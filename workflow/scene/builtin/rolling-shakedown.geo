// SPDX-License-Identifier: LGPL-3.0-or-later
// A slice of a half-plane, one cell thick: cells of one size under the way of the load, longer and
// longer ones towards the ends and below.
DefineConstant[ size = 0.001 ];        // m, edge of the cells near the surface
DefineConstant[ way = 0.028 ];         // m, half length of the zone of equal cells
DefineConstant[ length = 0.25 ];       // m, half length of the slice
DefineConstant[ fine_depth = 0.01 ];   // m, of equal cells
DefineConstant[ depth = 0.25 ];        // m
DefineConstant[ growth = 1.35 ];       // of neighbouring edges outside

nx = Round(2 * way / size);
nz = Round(fine_depth / size);
nl = Ceil(Log(1 + (length - way) / size * (growth - 1)) / Log(growth) - 0.5);
nd = Ceil(Log(1 + (depth - fine_depth) / size * (growth - 1)) / Log(growth) - 0.5);

x[] = {-length, -way, way, length};
z[] = {0, -fine_depth, -depth};
For j In {0 : 2}
  For i In {0 : 3}
    Point(1 + i + 4 * j) = {x[i], 0, z[j]};
  EndFor
EndFor
For j In {0 : 2}
  For i In {0 : 2}
    Line(1 + i + 3 * j) = {1 + i + 4 * j, 2 + i + 4 * j};
  EndFor
EndFor
For i In {0 : 3}
  Line(10 + i) = {1 + i, 5 + i};
  Line(14 + i) = {5 + i, 9 + i};
EndFor
For j In {0 : 1}
  For i In {0 : 2}
    Curve Loop(1 + i + 3 * j) = {1 + i + 3 * j, 11 + i + 4 * j, -(4 + i + 3 * j), -(10 + i + 4 * j)};
    Plane Surface(1 + i + 3 * j) = {1 + i + 3 * j};
  EndFor
EndFor
Transfinite Curve {1, 4, 7} = nl + 1 Using Progression 1 / growth;
Transfinite Curve {2, 5, 8} = nx + 1;
Transfinite Curve {3, 6, 9} = nl + 1 Using Progression growth;
Transfinite Curve {10 : 13} = nz + 1;
Transfinite Curve {14 : 17} = nd + 1 Using Progression growth;
Transfinite Surface "*";
Recombine Surface "*";

inside[] = {};
top[] = {};
sides[] = {};
ends[] = {};
bottom[] = {};
For k In {1 : 6}
  out[] = Extrude {0, size, 0} { Surface{k}; Layers{1}; Recombine; };
  // out: far side, volume, then a face for each curve of the loop: above, right, below, left
  inside[] += out[1];
  sides[] += {k, out[0]};
  If (k <= 3)
    top[] += out[2];
  EndIf
  If (k == 3 || k == 6)
    ends[] += out[3];
  EndIf
  If (k >= 4)
    bottom[] += out[4];
  EndIf
  If (k == 1 || k == 4)
    ends[] += out[5];
  EndIf
EndFor
Physical Volume("block") = {inside[]};
Physical Surface("top") = {top[]};
Physical Surface("sides") = {sides[]};
Physical Surface("ends") = {ends[]};
Physical Surface("bottom") = {bottom[]};
