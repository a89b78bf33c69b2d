/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* Node-to-facet contact on flat arrays: declarations and comments only, cffi reads this file.
 *
 * The nodes of a pair are stacked, contactor first: 0 <= c < nc are contactor nodes and
 * nc <= j < n target nodes. Arrays shared by several functions, all owned by the caller:
 *
 *   xv         [n][6]      current position and velocity                            m, m/s
 *   mass       [n]         nodal mass, infinite for rigid nodes                     kg
 *   area       [n]         tributary area on the undeformed surface                 m2
 *   dof        [n]         dof block owned by this rank, -1: none
 *   quad       [q][4]      target facets, counter-clockwise seen from outside
 *   kind       [q]         bit e: edge e (node e to e + 1) is on the open border;
 *                          bit 4: a neighbour meets it at a sharp angle
 *   size       [q]         square root of the facet's area                          m
 *   ring       [..]        target facets round node j: ring[around[j] .. around[j + 1])
 *   around     [n + 1]
 *   live       [q]         1 where all nodes of the facet are kept up to date
 *   outward    [nc][3]     outward unit normal of the contactor
 *   facet      [nc]        facet being tracked, -1: none
 *   xi         [nc][2]     local coordinates of the closest point, in [-1, 1]
 *   gap        [nc]        signed distance, negative = penetration                  m
 *   normal     [nc][3]     outward unit normal of the target at the closest point
 *   across     [q][4]      smooth target: neighbour over each edge that shares corner normals,
 *                          -1: border or sharp edge; NULL: bilinear facets
 *   corner     [q][4]      number of the normal at each corner
 *   normals    [m][3]      unit normals at corners
 *   offset     [nc]        overlap that does not count, added to the gap              m
 *   stiffness  [nc]        normal stiffness, 0: not in contact                      N/m
 *   damper     [nc]        normal damping constant                                  N s/m
 *   normal_force   [nc]        normal force, >= 0                                       N
 *   damping_force       [nc]        part of it that comes from damping                       N
 *   tangential_force   [nc][3]     tangential force on the contactor node                   N
 *   slip       [nc][3]     tangential slip since the last step                      m
 *   friction   [nc]        coefficient of friction
 *   total      [12]        0 friction and 1 damping dissipation, accumulated [J]; then of this
 *                          step: 2 normal and 3 tangential stored energy [J], 4 deepest
 *                          penetration, offsets counted in [m], 5 sum of normal forces [N], 6-8 resultant of the
 *                          normal and 9-11 of the tangential forces on the contactor [N]
 */

/* Positions and velocities of nodes whose dofs this rank owns; others are left alone.
 *   item  [k]       nodes to read
 *   X     [n][3]    reference positions                                             m
 *   u, v            displacement and velocity, flat, block size 3                   m, m/s
 *   past  [n][3]    positions to measure motion from                                m
 * Returns the largest distance moved from `past`. */
double wr_gather(int64_t k, const int32_t *item, const int32_t *dof, const double *X,
                 const double *u, const double *v, const double *past, double *xv);

/* Sorts boxes into the cells of a grid: first call with entry NULL counts, second call fills.
 *   box     [m][6]   low and high corner of each box                                m
 *   grid    [4]      origin of the grid and edge of a cell                          m
 *   dims    [3]      cells along each axis
 *   cursor  [cells]  in/out: counts (first call), next free place (second call)
 *   entry   [..]     out: box numbers, cell after cell
 * Returns the number of entries. */
int64_t wr_buckets(int64_t m, const double *box, const double *grid, const int64_t *dims,
                   int64_t *cursor, int32_t *entry);

/* Closest facet of each contactor node, out of those that share its grid cell.
 *   item   [k]       contactor nodes inside the grid
 *   pick   [m]       facet of each box, box [m][6] as above
 *   start  [cells+1] first entry of each cell
 *   above, below     a node counts within this distance outside / inside the target  m
 *   hit    [k]  out  1 where the node counts
 * Only facets whose normal opposes `outward` count. Nodes already in contact keep the facet that
 * they track. Sets facet and xi of hits, and live round them. Returns the number of hits. */
int64_t wr_search(int64_t k, const int32_t *item, const double *xv, const double *outward,
                  const int32_t *quad, const int32_t *pick, const double *box, const double *grid,
                  const int64_t *dims, const int64_t *start, const int32_t *entry, double above,
                  double below, const double *stiffness, int32_t *facet, double *xi, uint8_t *hit,
                  uint8_t *live);

/* Follows the closest point of k candidates across neighbouring facets; a node beyond the open
 * border gets an infinite gap. Returns the number of nodes with gap < 0. */
int64_t wr_track(int64_t k, const int32_t *item, const double *xv, const int32_t *quad,
                 const uint8_t *kind, const double *size, const int32_t *around,
                 const int32_t *ring, const uint8_t *live, const double *outward,
                 const int32_t *across, const int32_t *corner, const double *normals,
                 int32_t *facet, double *xi, double *gap, double *normal);

/* Averages the normals at the corners of m facets `fresh`; k of them, `used`, are written.
 *   mirror  [b][4]  by normal: a normal at the border, its node, an inner normal and its node */
void wr_normals(int64_t m, const int32_t *fresh, const int32_t *quad, const int32_t *corner,
                int64_t k, const int32_t *used, int64_t b, const int32_t *mirror, const double *xv,
                double *normals);

/* Normal force, and the slip that friction acts on.
 *   dt         time since the last step, 0 in statics                                s
 *   per_mass   normal stiffness per effective mass                                   1/s2
 *   per_area   normal stiffness per area and foundation modulus, where foundation_c is not NULL
 *   fraction   damping constant over the critical one
 *   ratio      tangential over normal stiffness
 *   fade       part of the offsets that is left
 *   foundation_c [nc], foundation_t [q]   foundation moduli: bulk modulus * area / volume of the cell  Pa/m
 *   touching   [nc] out: nodes with gap < 0
 * Adds the offsets to the gaps. Carries `tangential_force` over into the present tangent plane. Returns
 * the number of touching nodes. */
int64_t wr_normal(int64_t k, const int32_t *item, double dt, double per_mass, double per_area,
                  double fraction, double ratio, double fade, const double *foundation_c,
                  const double *foundation_t, const double *xv, const double *mass,
                  const double *area, const int32_t *quad, const int32_t *facet, const double *xi,
                  const double *normal, double *gap, double *stiffness, double *damper,
                  double *offset, double *normal_force, double *damping_force,
                  double *tangential_force, double *slip, int32_t *touching, double *total);

/* Coulomb return map, then adds the forces of both bodies to f (flat, block size 3) on owned dofs.
 * Returns the number of sticking nodes. */
int64_t wr_friction(int64_t k, const int32_t *touching, double ratio, const double *friction,
                    const double *xv, const double *mass, const int32_t *dof, const int32_t *quad,
                    const int32_t *facet, const double *xi, const double *gap, const double *normal,
                    const double *stiffness, const double *normal_force, const double *slip,
                    double *tangential_force, double *f, double *total);

/* Positions and velocities one step ahead, under the forces f of everything but the contact, of
 * nodes that this rank owns or that do not move.
 *   kick           time over which the forces act: dt, or dt / 2 where xv has the velocity at t  s
 *   ahead  [n][6]  as xv, at t + dt and t + dt / 2                                  m, m/s */
void wr_predict(int64_t k, const int32_t *item, const int32_t *dof, const double *mass, double dt,
                double kick, const double *xv, const double *f, double *ahead);

/* Deepest penetration of k nodes at the closest points that they have. */
double wr_overlap(int64_t k, const int32_t *touching, const double *xv, const int32_t *quad,
                  const int32_t *corner, const double *normals, const int32_t *facet,
                  const double *xi, const double *normal);

#define WR_ROW 22

/* Forces that close the gaps at t + dt without tension, Coulomb friction that stops the slip where
 * it can: projected Gauss-Seidel on the nodes coupled by the facets they share. They are added to
 * f and counted in total as by wr_friction.
 *   tolerance  last move over deepest overlap at which the sweeps end
 *   gap        in: at t + dt without contact; offsets are added                     m
 *   approach   [nc]  in/out: how far the node comes closer over the step, from force to force  m
 *   slip             in/out: tangential slip over the step, likewise                m
 *   normal_force, tangential_force  in: of the last step
 *   work [nc][WR_ROW], dv [n][3]   workspace
 *   info [2]   out: sweeps, last move over deepest overlap
 * Returns the number of touching nodes. */
int64_t wr_lagrange(int64_t k, const int32_t *item, double dt, double kick, double tolerance,
                    int64_t sweeps, double fade, const double *friction, const double *xv,
                    const double *ahead, const double *mass, const int32_t *dof,
                    const int32_t *quad, const int32_t *facet, const double *xi,
                    const double *normal, double *gap, double *stiffness, double *offset,
                    double *normal_force, double *approach, double *tangential_force, double *slip,
                    int32_t *touching, double *work, double *dv, double *f, double *total,
                    double *info);
