/* FATROP on a program of intervals: what stands before this file are the sizes and patterns of one problem and the
   functions of its interval.  Unknowns are x_0, u_0, x_1, u_1, .. x_N; conditions, interval by interval, the step to the
   next state and the path conditions.  Bounds are those of the unknowns followed by those of the conditions; a row is
   the number of one of them.  Sums are taken in the order in which CasADi takes them: the same bits come out. */

#if !__has_include("fatrop/ocp/hessian.hpp")
#error "a FATROP that leaves the right hand sides below its matrices to its caller"
#endif

#define NU (NY - NX)
#define NPATH (NH * DEGREE)
#define EACH (NX + NPATH)
#define SOME(n) ((n) > 0 ? (n) : 1)

static struct {
  struct FatropOcpCSolver* (*create)(struct FatropOcpCInterface*, FatropOcpCWrite, FatropOcpCFlush);
  int (*solve)(struct FatropOcpCSolver*);
  void (*destroy)(struct FatropOcpCSolver*);
  int (*set_number)(struct FatropOcpCSolver*, const char*, double);
  int (*set_whole)(struct FatropOcpCSolver*, const char*, int);
  const struct blasfeo_dvec* (*primal)(struct FatropOcpCSolver*);
  const struct FatropOcpCStats* (*statistics)(struct FatropOcpCSolver*);
  void (*pack)(int, int, double*, int, struct blasfeo_dmat*, int, int);
} fatrop;

typedef struct {
  int intervals, unknowns, conditions;
  int broken;                            /* a derivative was not finite */
  const double *guess, *lower, *upper, *widths, *data, *parameters;
  double *values, *cost;                 /* of unknowns and conditions, for the caller */
  struct FatropOcpCInterface interface;
  struct FatropOcpCSolver* solver;       /* kept as long as the rows are of the same kinds */
  double *x, *slope, *multipliers;       /* scratch */
  double *step, *path;                   /* derivatives of the steps and of the path conditions, of all intervals */
  int *equal, *equal_from;               /* rows of equations, and the first of each stage */
  int *between, *between_from;           /* the same of inequalities */
  int* kinds;                            /* of all rows */
} Program;

static int smaller(int a, int b) { return a < b ? a : b; }

/* The number of an unknown of a stage in FATROP's order, which is controls, then states. */
static int swapped(const Program* s, int stage, int j) {
  if (stage == s->intervals) return j;
  return j < NX ? NU + j : j - NX;
}

static int stage_size(const Program* s, int stage) { return stage == s->intervals ? NX : NY; }

static void gather(const Program* s, int first, const double* x, lanes* y, lanes* d, lanes* h) {
  for (int l = 0; l < LANES; ++l) {
    const int k = smaller(first + l, s->intervals - 1);
    for (int j = 0; j < NY; ++j) y[j][l] = x[k * NY + j];
    for (int j = 0; j < ND * DEGREE; ++j) d[j][l] = s->data[k * ND * DEGREE + j];
    h[0][l] = s->widths[k];
  }
}

#define EACH_GROUP for (int first = 0; first < s->intervals; first += LANES)
#define EACH_LANE for (int k = first, l = 0; l < LANES && k < s->intervals; ++k, ++l)

static void at_ends(const Program* s, const double* x, lanes* start, lanes* end) {
  for (int j = 0; j < NX; ++j) {
    for (int l = 0; l < LANES; ++l) {
      start[j][l] = x[j];
      end[j][l] = x[s->intervals * NY + j];
    }
  }
}

static double evaluate_cost(const Program* s, const double* x) {
  double sum = 0.0;
  lanes y[NY], d[SOME(ND * DEGREE)], h[1], v[DEGREE], start[NX], end[NX], last[1];
  EACH_GROUP {
    gather(s, first, x, y, d, h);
    interval_integrand(y, d, s->parameters, h, v);
    EACH_LANE for (int i = 0; i < DEGREE; ++i) sum += (WEIGHTS[i] * s->widths[k]) * v[i][l];
  }
  at_ends(s, x, start, end);
  end_cost(start, end, s->parameters, last);
  return sum + last[0][0];
}

static void evaluate_slope(const Program* s, const double* x, double* slope) {
  lanes y[NY], d[SOME(ND * DEGREE)], h[1], v[NY], start[NX], end[NX], both[2 * NX];
  EACH_GROUP {
    gather(s, first, x, y, d, h);
    interval_gradient(y, d, s->parameters, h, v);
    EACH_LANE for (int j = 0; j < NY; ++j) slope[k * NY + j] = v[j][l];
  }
  at_ends(s, x, start, end);
  end_gradient(start, end, s->parameters, both);
  for (int j = 0; j < NX; ++j) {
    slope[j] += both[j][0];
    slope[s->intervals * NY + j] = both[NX + j][0];
  }
}

static void evaluate_conditions(const Program* s, const double* x, double* g) {
  lanes y[NY], d[SOME(ND * DEGREE)], h[1], v[SOME(EACH)];
  EACH_GROUP {
    gather(s, first, x, y, d, h);
    interval_step(y, h, v);
    EACH_LANE for (int j = 0; j < NX; ++j) g[k * EACH + j] = x[(k + 1) * NY + j] + v[j][l];
#if NH > 0
    interval_path(y, d, s->parameters, h, v);
    EACH_LANE for (int j = 0; j < NPATH; ++j) g[k * EACH + NX + j] = v[j][l];
#endif
  }
}

static void evaluate_rows(const Program* s, const double* x) {
  lanes y[NY], d[SOME(ND * DEGREE)], h[1], v[SOME(NSTEP)], w[SOME(NROWS)];
  EACH_GROUP {
    gather(s, first, x, y, d, h);
    interval_step_slopes(h, v);
    EACH_LANE for (int e = 0; e < NSTEP; ++e) s->step[k * NSTEP + e] = v[e][l];
#if NH > 0
    interval_rows(y, d, s->parameters, h, w);
    EACH_LANE for (int e = 0; e < NROWS; ++e) s->path[k * NROWS + e] = w[e][l];
#endif
  }
}

/* FATROP may never come back from a derivative that is no number: it gets a zero, and its answer is not used. */
static void settle(Program* s, double* values, int count) {
  for (int i = 0; i < count; ++i) {
    if (isfinite(values[i])) continue;
    values[i] = 0.0;
    s->broken = 1;
  }
}

static double value_of(const Program* s, int row) {
  return row < s->unknowns ? s->x[row] : s->values[row];
}

/* Unknowns from FATROP's order, and the conditions there. */
static void read_unknowns(const Program* s, const double* primal) {
  for (int k = 0; k <= s->intervals; ++k) {
    for (int j = 0; j < stage_size(s, k); ++j) s->x[k * NY + j] = primal[k * NY + swapped(s, k, j)];
  }
}

static int eval_cost(double scale, const double* primal, const double* a, const double* b, double* result,
                     const struct FatropOcpCDims* dims, void* program) {
  Program* s = program;
  read_unknowns(s, primal);
  *result = evaluate_cost(s, s->x) * scale;
  return 1;
}

static int eval_slope(double scale, const double* primal, const double* a, const double* b, double* result,
                      const struct FatropOcpCDims* dims, void* program) {
  Program* s = program;
  read_unknowns(s, primal);
  evaluate_slope(s, s->x, s->slope);
  settle(s, s->slope, s->unknowns);
  for (int k = 0; k <= s->intervals; ++k) {
    for (int j = 0; j < stage_size(s, k); ++j) result[k * NY + swapped(s, k, j)] = s->slope[k * NY + j] * scale;
  }
  return 1;
}

static int eval_conditions(const double* primal, const double* a, const double* b, double* result,
                           const struct FatropOcpCDims* dims, void* program) {
  Program* s = program;
  read_unknowns(s, primal);
  evaluate_conditions(s, s->x, s->values + s->unknowns);
  for (int k = 0; k <= s->intervals; ++k) {
    double* to = result + dims->g_ineq_offs[k];
    for (int i = s->between_from[k]; i < s->between_from[k + 1]; ++i) *to++ = value_of(s, s->between[i]);
    to = result + dims->g_offs[k];
    for (int i = s->equal_from[k]; i < s->equal_from[k + 1]; ++i) {
      *to++ = value_of(s, s->equal[i]) - s->lower[s->equal[i]];
    }
  }
  for (int k = 0; k < s->intervals; ++k) {
    for (int j = 0; j < NX; ++j) {
      const int row = s->unknowns + k * EACH + j;
      result[dims->dyn_eq_offs[k] + j] = s->lower[row] - s->values[row];
    }
  }
  return 1;
}

/* The derivatives of some rows of a stage, a column each.  Below these, as below all matrices, FATROP puts right hand
   sides of its own. */
static void pack_rows(const Program* s, int k, const int* rows, int count, struct blasfeo_dmat* into) {
  const int size = stage_size(s, k);
  double block[NY * (NPATH + NY)], dense[SOME(NPATH)][NY];
  if (count == 0) return;
  memset(block, 0, sizeof(double) * size * count);
  memset(dense, 0, sizeof dense);
  if (k < s->intervals) {
    for (int e = 0; e < NROWS; ++e) dense[ROWS_ROW[e]][ROWS_COLUMN[e]] = s->path[k * NROWS + e];
  }
  for (int i = 0; i < count; ++i) {
    double* column = block + i * size;
    if (rows[i] < s->unknowns) {
      column[swapped(s, k, rows[i] - k * NY)] = 1.0;
    } else {
      const double* from = dense[rows[i] - s->unknowns - k * EACH - NX];
      for (int j = 0; j < size; ++j) column[swapped(s, k, j)] = from[j];
    }
  }
  fatrop.pack(size, count, block, size, into, 0, 0);
}

static int eval_rows(const double* primal, const double* a, const double* b, struct blasfeo_dmat* steps,
                     struct blasfeo_dmat* equal, struct blasfeo_dmat* between, const struct FatropOcpCDims* dims,
                     void* program) {
  Program* s = program;
  double block[NY * NX];
  read_unknowns(s, primal);
  evaluate_rows(s, s->x);
  settle(s, s->path, s->intervals * NROWS);
  for (int k = 0; k <= s->intervals; ++k) {
    const int equations = s->equal_from[k], others = s->between_from[k];
    pack_rows(s, k, s->equal + equations, s->equal_from[k + 1] - equations, equal + k);
    pack_rows(s, k, s->between + others, s->between_from[k + 1] - others, between + k);
    if (k == s->intervals) break;
    memset(block, 0, sizeof block);
    for (int e = 0; e < NSTEP; ++e) {
      block[STEP_ROW[e] * NY + swapped(s, k, STEP_COLUMN[e])] = -s->step[k * NSTEP + e];
    }
    fatrop.pack(NY, NX, block, NY, steps + k, 0, 0);
  }
  return 1;
}

/* Multipliers of the path conditions; free ones have none, and the steps are linear. */
static void read_multipliers(const Program* s, const double* lam, const struct FatropOcpCDims* dims) {
  double* to = s->multipliers - s->unknowns;
  memset(s->multipliers, 0, sizeof(double) * s->conditions);
  for (int k = 0; k < s->intervals; ++k) {
    const double* from = lam + dims->g_ineq_offs[k];
    for (int i = s->between_from[k]; i < s->between_from[k + 1]; ++i, ++from) {
      if (s->between[i] >= s->unknowns) to[s->between[i]] = *from;
    }
    from = lam + dims->g_offs[k];
    for (int i = s->equal_from[k]; i < s->equal_from[k + 1]; ++i, ++from) {
      if (s->equal[i] >= s->unknowns) to[s->equal[i]] = *from;
    }
  }
}

/* Adds the part of the ends to the second derivatives of a stage. */
static void add_ends(const Program* s, int k, const lanes* ends, double* upper) {
  const int from = k == 0 ? 0 : NX;
  for (int e = 0; e < NEND; ++e) {
    const int row = END_ROW[e] - from, column = END_COLUMN[e] - from;
    if (row >= 0 && row < NX && column >= 0 && column < NX) upper[row * NY + column] += ends[e][0];
  }
}

static void evaluate_curvature(const Program* s, int first, double scale, lanes* v) {
  lanes y[NY], d[SOME(ND * DEGREE)], h[1], weights[DEGREE], multipliers[SOME(NPATH)];
  gather(s, first, s->x, y, d, h);
  for (int i = 0; i < DEGREE; ++i) {
    for (int l = 0; l < LANES; ++l) weights[i][l] = scale * (WEIGHTS[i] * h[0][l]);
  }
  for (int l = 0; l < LANES; ++l) {
    const int k = smaller(first + l, s->intervals - 1);
    for (int j = 0; j < NPATH; ++j) multipliers[j][l] = s->multipliers[k * EACH + NX + j];
  }
#if NH > 0
  interval_curvature(y, d, s->parameters, h, weights, multipliers, v);
#else
  interval_curvature(y, d, s->parameters, h, weights, v);
#endif
}

static void pack_curvature(const Program* s, int k, const double* upper, struct blasfeo_dmat* into) {
  const int size = stage_size(s, k);
  double block[NY * NY];
  for (int j = 0; j < size; ++j) {
    const int column = swapped(s, k, j);
    for (int i = 0; i <= j; ++i) {
      const int row = swapped(s, k, i);
      block[column * size + row] = block[row * size + column] = upper[i * NY + j];
    }
  }
  fatrop.pack(size, size, block, size, into, 0, 0);
}

static int eval_curvature(double scale, const double* primal, const double* lam, const double* a, const double* b,
                          struct blasfeo_dmat* into, const struct FatropOcpCDims* dims, void* program) {
  Program* s = program;
  double upper[NY * NY];
  lanes v[SOME(NCURVE)], start[NX], end[NX], factor[1], ends[SOME(NEND)];
  read_unknowns(s, primal);
  read_multipliers(s, lam, dims);
  at_ends(s, s->x, start, end);
  for (int l = 0; l < LANES; ++l) factor[0][l] = scale;
  end_curvature(start, end, s->parameters, factor, ends);
  EACH_GROUP {
    evaluate_curvature(s, first, scale, v);
    EACH_LANE {
      memset(upper, 0, sizeof upper);
      for (int e = 0; e < NCURVE; ++e) upper[CURVE_ROW[e] * NY + CURVE_COLUMN[e]] = v[e][l];
      if (k == 0) add_ends(s, k, ends, upper);
      settle(s, upper, NY * NY);
      pack_curvature(s, k, upper, into + k);
    }
  }
  memset(upper, 0, sizeof upper);
  add_ends(s, s->intervals, ends, upper);
  settle(s, upper, NY * NY);
  pack_curvature(s, s->intervals, upper, into + s->intervals);
  return 1;
}

static int get_intervals(void* program) { return ((Program*)program)->intervals + 1; }
static int get_states(int k, void* program) { return NX; }
static int get_controls(int k, void* program) { return stage_size(program, k) - NX; }

static int get_equal(int k, void* program) {
  const int* from = ((Program*)program)->equal_from;
  return from[k + 1] - from[k];
}

static int get_between(int k, void* program) {
  const int* from = ((Program*)program)->between_from;
  return from[k + 1] - from[k];
}

static int get_bounds(double* lower, double* upper, int k, void* program) {
  const Program* s = program;
  for (int i = s->between_from[k]; i < s->between_from[k + 1]; ++i) {
    *lower++ = s->lower[s->between[i]];
    *upper++ = s->upper[s->between[i]];
  }
  return 0;
}

static int get_first_states(double* x, int k, void* program) {
  memcpy(x, ((Program*)program)->guess + k * NY, sizeof(double) * NX);
  return 0;
}

static int get_first_controls(double* u, int k, void* program) {
  memcpy(u, ((Program*)program)->guess + k * NY + NX, sizeof(double) * (stage_size(program, k) - NX));
  return 0;
}

enum { UNSORTED, FREE, EQUATION, INEQUALITY };

static void sort_row(const Program* s, int row, int* equations, int* others) {
  if (s->kinds[row] == EQUATION) s->equal[(*equations)++] = row;
  if (s->kinds[row] == INEQUALITY) s->between[(*others)++] = row;
}

/* Which rows are equations, which inequalities, and which neither; conditions of a stage before its unknowns.
   Tells whether anything is another way than before. */
static int sort_rows(Program* s) {
  int equations = 0, others = 0, changed = 0;
  for (int row = 0; row < s->unknowns + s->conditions; ++row) {
    const double lower = s->lower[row], upper = s->upper[row];
    const int bounded = lower != -INFINITY || upper != INFINITY;
    const int kind = lower == upper ? EQUATION : bounded ? INEQUALITY : FREE;
    changed |= kind != s->kinds[row];
    s->kinds[row] = kind;
  }
  if (!changed) return 0;
  for (int k = 0; k <= s->intervals; ++k) {
    s->equal_from[k] = equations;
    s->between_from[k] = others;
    for (int j = NX; k < s->intervals && j < EACH; ++j) sort_row(s, s->unknowns + k * EACH + j, &equations, &others);
    for (int j = 0; j < stage_size(s, k); ++j) sort_row(s, k * NY + j, &equations, &others);
  }
  s->equal_from[s->intervals + 1] = equations;
  s->between_from[s->intervals + 1] = others;
  return 1;
}

static void say_nothing(const char* text, int length) {}

void occ_bind(void** functions) { memcpy(&fatrop, functions, sizeof fatrop); }

/* Memory for some intervals; null where there is none.  The caller's arrays are read and written in place. */
void* occ_create(int intervals, const double* guess, const double* numbers, const double* lower, const double* upper,
                 double* values, double* cost) {
  Program* s = calloc(1, sizeof *s);
  if (!s) return 0;
  const int n = intervals * NY + NX, m = intervals * EACH, rows = n + m;
  s->intervals = intervals, s->unknowns = n, s->conditions = m;
  s->guess = guess, s->lower = lower, s->upper = upper, s->values = values, s->cost = cost;
  s->widths = numbers, s->data = numbers + intervals, s->parameters = s->data + intervals * ND * DEGREE;
  double* reals = calloc(2 * n + m + intervals * (NSTEP + NROWS) + 1, sizeof *reals);
  int* wholes = calloc(3 * rows + 2 * (intervals + 2), sizeof *wholes);
  s->x = reals, s->equal = wholes;
  if (!reals || !wholes) return free(reals), free(wholes), free(s), (void*)0;
  s->slope = s->x + n, s->multipliers = s->slope + n, s->step = s->multipliers + m;
  s->path = s->step + intervals * NSTEP;
  s->between = s->equal + rows, s->kinds = s->between + rows;
  s->equal_from = s->kinds + rows, s->between_from = s->equal_from + intervals + 2;
  s->interface = (struct FatropOcpCInterface){
    .get_nx = get_states, .get_nu = get_controls, .get_ng = get_equal, .get_ng_ineq = get_between,
    .get_horizon_length = get_intervals, .get_bounds = get_bounds, .get_initial_xk = get_first_states,
    .get_initial_uk = get_first_controls, .full_eval_lag_hess = eval_curvature, .full_eval_constr_jac = eval_rows,
    .full_eval_contr_viol = eval_conditions, .full_eval_obj_grad = eval_slope, .full_eval_obj = eval_cost,
    .user_data = s,
  };
  return s;
}

static void forget_solver(Program* s) {
  if (s->solver) fatrop.destroy(s->solver);
  s->solver = 0;
}

void occ_free(void* program) {
  Program* s = program;
  forget_solver(s);
  free(s->x), free(s->equal), free(s);
}

static int all_finite(const double* values, int count) {
  for (int i = 0; i < count; ++i) {
    if (!isfinite(values[i])) return 0;
  }
  return 1;
}

/* All that an iteration evaluates, once, at the guess; tells whether it is finite. */
int occ_evaluate(void* program) {
  Program* s = program;
  lanes v[SOME(NCURVE)];
  memcpy(s->x, s->guess, sizeof(double) * s->unknowns);
  memset(s->multipliers, 0, sizeof(double) * s->conditions);
  *s->cost = evaluate_cost(s, s->x);
  evaluate_conditions(s, s->x, s->values + s->unknowns);
  evaluate_slope(s, s->x, s->slope);
  evaluate_rows(s, s->x);
  int finite = all_finite(s->cost, 1) && all_finite(s->values + s->unknowns, s->conditions);
  finite = finite && all_finite(s->slope, s->unknowns) && all_finite(s->path, s->intervals * NROWS);
  EACH_GROUP {
    evaluate_curvature(s, first, 1.0, v);
    for (int e = 0; e < NCURVE; ++e) {
      for (int l = 0; l < LANES; ++l) finite = finite && isfinite(v[e][l]);
    }
  }
  return finite;
}

enum { NOT_FINITE = -2 };

/* One solve; the settings, whole numbers first, are always the same.  FATROP's return value, or that something is not
   finite; iterations into the last argument. */
int occ_solve(void* program, int wholes, int count, const char** names, const double* settings, int* iterations) {
  Program* s = program;
  *iterations = 0;
  if (!occ_evaluate(s)) {
    memcpy(s->values, s->x, sizeof(double) * s->unknowns);
    *s->cost = NAN;
    return NOT_FINITE;
  }
  if (sort_rows(s)) forget_solver(s);
  if (!s->solver) {
    s->solver = fatrop.create(&s->interface, say_nothing, 0);
    for (int i = 0; i < count; ++i) {
      if (i < wholes) fatrop.set_whole(s->solver, names[i], (int)settings[i]);
      else fatrop.set_number(s->solver, names[i], settings[i]);
    }
  }
  s->broken = 0;
  const int told = fatrop.solve(s->solver);
  *iterations = fatrop.statistics(s->solver)->iterations_count;
  read_unknowns(s, fatrop.primal(s->solver)->pa);
  /* After an exception nobody knows what state it is in. */
  if (told < 0) forget_solver(s);
  memcpy(s->values, s->x, sizeof(double) * s->unknowns);
  evaluate_conditions(s, s->x, s->values + s->unknowns);
  *s->cost = evaluate_cost(s, s->x);
  return s->broken ? NOT_FINITE : told;
}
