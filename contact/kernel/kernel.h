/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* Contact of points with facets on flat arrays: declarations and comments only, cffi reads this
 * file.
 *
 * What touches are the contactor's nodes or points in its facets. The nodes of a pass are stacked:
 * 0 <= c < nc are what touches, and nc <= j < n the target's nodes, then, where points touch, those
 * of the contactor. `Contactor node` is said for both. All arrays are owned by the caller. */

#define WR_SHARP 16
#define WR_ROW 7

/* Facets of the target. */
typedef struct {
  const int32_t *quad;   /* [q][4]  nodes, counter-clockwise seen from outside */
  const uint8_t *kind;   /* [q]     bit e: edge e (node e to e + 1) is on the open border;
                                    bit WR_SHARP: a neighbour meets it at a sharp angle */
  const double *size;    /* [q]     square root of the facet's area                       m */
  const int32_t *ring;   /* [..]    facets round node j: ring[around[j] .. around[j + 1]) */
  const int32_t *around; /* [n + 1] */
  const int32_t *across; /* [q][4]  smooth target: neighbour over each edge that shares corner
                                    normals, -1: border or sharp edge; NULL: bilinear facets */
  const int32_t *corner; /* [q][4]  number of the normal at each corner */
  double *normals;       /* [m][3]  unit normals at corners */
} wr_target;

/* Points in the facets of the contactor, that touch instead of its nodes. */
typedef struct {
  const int32_t *node;    /* [nc][4]  nodes of the facet */
  const double *weight;   /* [nc][4]  their shape functions at the point */
  const double *per_mass; /* [nc][4]  weight / mass                                          1/kg */
  const double *height;   /* [nc]     of the undeformed curved surface over the facet there     m */
} wr_points;

/* What a pass is made of. */
typedef struct {
  const wr_target *target;
  const wr_points *points;    /*         NULL: the contactor's nodes touch */
  const double *xv;           /* [n][6]  current position and velocity                 m, m/s */
  const double *mass;         /* [n]     mass of a node or point, infinite if rigid        kg */
  const double *area;         /* [n]     its area on the undeformed surface                m2 */
  const int32_t *dof;         /* [n]     dof block owned by this rank, -1: none */
  const double *foundation_c; /* [nc]    foundation moduli: bulk modulus * area / volume of the */
  const double *foundation_t; /* [q]     cell; NULL where springs follow the mass        Pa/m */
  double per_mass;            /*         normal stiffness per effective mass             1/s2 */
  double per_area;            /*         normal stiffness per area and foundation modulus */
  double damping;             /*         damping constant over the critical one */
  double tangential;          /*         tangential over normal stiffness */
} wr_pass;

/* Contactor nodes that may touch. */
typedef struct {
  int64_t k;
  int32_t *item;   /* [k]      nodes, ascending */
  double *outward; /* [nc][3]  outward unit normal of the contactor near the target */
  uint8_t *live;   /* [q]      1 where all nodes of the facet are kept up to date */
  int32_t *facet;  /* [nc]     facet to start tracking from */
  double *xi;      /* [nc][2]  local coordinates there */
} wr_candidates;

/* Sums over the nodes of a pass. */
typedef struct {
  double friction_dissipation;    /* accumulated                                              J */
  double damping_dissipation;     /* accumulated                                              J */
  double normal_energy;           /* stored, of this step, as all that follows                J */
  double tangential_energy;       /*                                                          J */
  double max_penetration;         /* offsets counted in                                       m */
  double normal_force;            /* sum of the nodal normal forces                           N */
  double normal_resultant[3];     /* of the normal forces on the contactor                    N */
  double tangential_resultant[3]; /* of the tangential ones                                 N */
} wr_totals;

/* Contact of each contactor node. */
typedef struct {
  int32_t *facet;           /* [nc]     facet being tracked, -1: none */
  double *xi;               /* [nc][2]  local coordinates of the closest point, in [-1, 1] */
  double *gap;              /* [nc]     signed distance, negative = penetration             m */
  double *normal;           /* [nc][3]  outward unit normal of the target at the closest point */
  double *offset;           /* [nc]     overlap that does not count, added to the gap       m */
  double *stiffness;        /* [nc]     normal stiffness, 0: not in contact               N/m */
  double *damper;           /* [nc]     normal damping constant                         N s/m */
  double *normal_force;     /* [nc]     normal force, >= 0                                  N */
  double *damping_force;    /* [nc]     part of it that comes from damping                  N */
  double *tangential_force; /* [nc][3]  on the contactor node                               N */
  double *slip;             /* [nc][3]  tangential slip since the last step                 m */
  double *friction;         /* [nc]     coefficient of friction */
  int32_t *touching;        /* [nc]     the first ones: nodes in touch */
  wr_totals *totals;
} wr_state;

/* Boxes round facets, sorted into the cells of a grid. */
typedef struct {
  const double *box;    /* [m][6]       low and high corner of each box                     m */
  const int32_t *pick;  /* [m]          facet of each box */
  double origin[3];     /*              of the grid                                         m */
  double edge;          /*              of a cell                                           m */
  int64_t dims[3];      /*              cells along each axis */
  const int64_t *start; /* [cells + 1]  first entry of each cell */
  const int32_t *entry; /* [..]         box numbers, cell after cell */
} wr_grid;

/* One contact among those that wr_implicit solves for. */
typedef struct {
  double N[4], per_mass[5]; /* weights of the facet's nodes; 1 / mass of node and facet's nodes */
  double n[3], w[3];        /* normal; relative velocity without contact, free of spin */
  double p, t[3], held[3];  /* normal and tangential force; the latter at the last step */
  double gap, friction;     /* gap at t + dt without contact; coefficient of friction */
  double inverse, give[2];  /* 1 / W; 1 / (dt * stiffness), normal and tangential */
} wr_row;

/* Projected Gauss-Seidel of a pass. */
typedef struct {
  double tolerance;    /*          last move over deepest overlap at which the sweeps end */
  int64_t most;        /*          sweeps at most */
  int64_t springs;     /*          1: springs of the stiffness of the pass; 0: no give */
  const double *ahead; /* [n][6]   as xv, at t + dt and t + dt / 2                   m, m/s */
  wr_row *row;         /* [nc]     workspace */
  double *dv;          /* [n][3]   workspace */
  int64_t sweeps;      /*     out  sweeps */
  double residual;     /*     out  last move over deepest overlap */
} wr_solver;

/* Positions and velocities of nodes whose dofs this rank owns; others are left alone.
 *   item  [k]       nodes to read
 *   X     [n][3]    reference positions                                             m
 *   u, v            displacement and velocity, flat, block size 3                   m, m/s
 *   past  [n][3]    positions to measure motion from                                m
 * Returns the largest distance moved from `past`. */
double wr_gather(int64_t k, const int32_t *item, const int32_t *dof, const double *X,
                 const double *u, const double *v, const double *past, double *xv);

/* Positions and velocities of k points from those of their nodes, which xv holds too. */
void wr_place(const wr_points *points, int64_t k, const int32_t *item, double *xv);

/* Takes the heights of the candidates off their gaps. */
void wr_raise(const wr_points *points, const wr_candidates *near, wr_state *state);

/* Smallest box (low corner, high corner) round k nodes. */
void wr_bounds(int64_t k, const double *xv, double *box);

/* Largest speed of k nodes relative to the velocity v. */
double wr_fastest(int64_t k, const double *xv, const double *v);

/* Which of k nodes are in a box; returns their number, item [k] out. */
int64_t wr_within(int64_t k, const double *xv, const double *box, int32_t *item);

/* Which of q facets come into a box with boxes wider than themselves by `pad`; returns their number.
 *   pick   [q]     out: facets
 *   boxes  [q][6]  out: their boxes, low and high corner */
int64_t wr_facets_within(const wr_target *target, int64_t q, const double *xv, double pad,
                         const double *box, int32_t *pick, double *boxes);

/* Outward normals of nc contactor nodes, right at those marked `near` [nc], from its q facets. */
void wr_outward(int64_t q, const int32_t *quad, const uint8_t *near, int64_t nc, const double *xv,
                double *outward);

/* Closest points of candidates as rows of WR_ROW doubles (facet, gap, xi, normal), and back. */
void wr_pack(const wr_candidates *near, const wr_state *state, double *row);
void wr_unpack(const wr_candidates *near, const double *row, wr_state *state);

/* Sorts m boxes into cells: first call with entry NULL counts, second call fills.
 *   cursor  [cells]  in/out: counts (first call), next free place (second call)
 *   entry   [..]     out: box numbers, cell after cell
 * Returns the number of entries. */
int64_t wr_buckets(int64_t m, const wr_grid *grid, int64_t *cursor, int32_t *entry);

/* Closest facet of each contactor node, out of those that share its grid cell.
 *   near          in: nodes inside the grid, outward and facet; out: k and item of those that
 *                 count, their facet and xi, and live round them
 *   above, below  a node counts within this distance outside / inside the target    m
 *   stiffness     [nc], of the pass
 * Only facets whose normal opposes `outward` count. Nodes already in contact keep the facet that
 * they track. */
void wr_search(const wr_target *target, const wr_grid *grid, const double *xv, double above,
               double below, const double *stiffness, wr_candidates *near);

/* Follows the closest points of the candidates at xv across neighbouring facets; a node beyond the
 * open border gets an infinite gap. Returns the number of nodes with gap < 0. */
int64_t wr_track(const wr_target *target, const wr_candidates *near, const double *xv,
                 wr_state *state);

/* Averages the normals at the corners of m facets `fresh`; k of them, `used`, are written.
 *   mirror  [b][4]  by normal: a normal at the border, its node, an inner normal and its node */
void wr_normals(const wr_target *target, int64_t m, const int32_t *fresh, int64_t k,
                const int32_t *used, int64_t b, const int32_t *mirror, const double *xv);

/* Effective mass of the candidates at their closest points, as wr_normal uses it, and the area
 * that both sides bring, mass [k] and shared [k] out.                               kg, m2 */
void wr_effective_mass(const wr_pass *pass, const wr_candidates *near, const wr_state *state,
                       double *mass, double *shared);

/* Normal force, and the slip that friction acts on.
 *   dt    time since the last step, 0 in statics                                    s
 *   fade  part of the offsets that is left
 * Adds the offsets to the gaps. Carries the tangential force over into the present tangent plane.
 * Returns the number of touching nodes. */
int64_t wr_normal(const wr_pass *pass, const wr_candidates *near, wr_state *state, double dt,
                  double fade);

/* Coulomb return map of k touching nodes, then adds the forces of both bodies to f (flat, block
 * size 3) on owned dofs; without friction if that is NULL. Returns the number of sticking nodes. */
int64_t wr_friction(const wr_pass *pass, wr_state *state, int64_t k, const double *friction,
                    double *f);

/* Positions and velocities one step ahead, under the forces f of everything but the contact, of
 * nodes that this rank owns or that do not move.
 *   kick           time over which the forces act: dt, or dt / 2 where xv has the velocity at t  s
 *   ahead  [n][6]  as xv, at t + dt and t + dt / 2                                  m, m/s */
void wr_predict(const wr_pass *pass, int64_t k, const int32_t *item, double dt, double kick,
                const double *f, double *ahead);

/* Ends the step that has brought xv, on the closest points of its start: counts the second half of
 * the work of its forces (at rest: none) and sets the slip of k touching nodes and the deepest
 * penetration. */
void wr_settle(const wr_pass *pass, wr_state *state, int64_t k, double dt);

/* Forces at t that the springs of all touching nodes have at t + dt, without tension; or, without
 * springs, that close the gaps. Coulomb friction holds where it can. Projected Gauss-Seidel on the
 * nodes coupled by the facets they share. The forces are added to f and counted in the totals as by
 * wr_friction.
 *   state  in: gap at t + dt without contact, to which offsets are added; forces of the last step
 * Returns the number of touching nodes. */
int64_t wr_implicit(const wr_pass *pass, const wr_candidates *near, wr_state *state,
                    wr_solver *solver, double dt, double kick, double fade, double *f);
