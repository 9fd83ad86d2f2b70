// Nodal forces and tangents of straight quadratic tetrahedra from stresses and point tangents. Before this text stand the sizes
// (N_POINTS, N_PACKS, N_GRADIENTS, MEANS), the tables, and `stresses` and `tangents`, made of UFL for LANES points at once.
// A kernel adds to A as DOLFINx asks; K are the gradients of the reference coordinates.

static inline double invert(const double* x, double K[3][3])
{
  double J[3][3];
  for (int i = 0; i < 3; ++i)
    for (int m = 0; m < 3; ++m)
      J[i][m] = x[3 * (m + 1) + i] - x[i];
  for (int m = 0; m < 3; ++m)
    for (int i = 0; i < 3; ++i)
      K[m][i] = J[(i + 1) % 3][(m + 1) % 3] * J[(i + 2) % 3][(m + 2) % 3] - J[(i + 1) % 3][(m + 2) % 3] * J[(i + 2) % 3][(m + 1) % 3];
  const double det = J[0][0] * K[0][0] + J[1][0] * K[0][1] + J[2][0] * K[0][2];
  for (int m = 0; m < 3; ++m)
    for (int i = 0; i < 3; ++i)
      K[m][i] /= det;
  return fabs(det);
}

// Gradients at all points of the nodal functions that come first in w
static inline void differentiate(const double* w, double K[3][3], vector H[N_GRADIENTS][9][N_PACKS])
{
  for (int f = 0; f < N_GRADIENTS; ++f)
    for (int i = 0; i < 3; ++i)
      for (int p = 0; p < N_PACKS; ++p)
      {
        vector d[3] = {0};
        for (int a = 0; a < 10; ++a)
          for (int m = 0; m < 3; ++m)
            d[m] += w[30 * f + 3 * a + i] * NODE_SLOPES[a][m][p];
        for (int L = 0; L < 3; ++L)
          H[f][3 * i + L][p] = K[0][L] * d[0] + K[1][L] * d[1] + K[2][L] * d[2];
      }
}

void forces(double* restrict b, double* w, const double* c, const double* x, const int* entity, const uint8_t* permutation, void* data)
{
  double K[3][3];
  const double det = invert(x, K);
  vector H[N_GRADIENTS][9][N_PACKS], P[9][N_PACKS];
  differentiate(w, K, H);
  stresses(w, c, H, P);
  for (int i = 0; i < 3; ++i)
  {
    vector d[3][N_PACKS];
    for (int p = 0; p < N_PACKS; ++p)
      for (int m = 0; m < 3; ++m)
        d[m][p] = det * WEIGHTS[p] * (K[m][0] * P[3 * i][p] + K[m][1] * P[3 * i + 1][p] + K[m][2] * P[3 * i + 2][p]);
    for (int a = 0; a < 10; ++a)
    {
      vector sum = {0};
      for (int p = 0; p < N_PACKS; ++p)
        for (int m = 0; m < 3; ++m)
          sum += d[m][p] * NODE_SLOPES[a][m][p];
      b[3 * a + i] += sum[0] + sum[1] + sum[2] + sum[3];
    }
  }
}

// Place of D[r][s] = D[s][r] among those on and above the diagonal
static inline int upper(int r, int s)
{
  return r <= s ? 9 * r - r * (r - 1) / 2 + s - r : 9 * s - s * (s - 1) / 2 + r - s;
}

// The integrals of the point tangents are left in w, for `coarse_tangent`
void tangent(double* restrict A, double* w, const double* c, const double* x, const int* entity, const uint8_t* permutation, void* data)
{
  enum { N = 10, V = (N + LANES - 1) / LANES };
  double K[3][3];
  const double det = invert(x, K);
  vector H[N_GRADIENTS][9][N_PACKS], D[UPPER][N_PACKS], G[3 * N_POINTS][V], T[3 * N_POINTS][V];
  differentiate(w, K, H);
  w[MEANS + UPPER] = det * tangents(w, c, H, D);
  for (int r = 0; r < UPPER; ++r)
  {
    vector sum = {0};
    for (int p = 0; p < N_PACKS; ++p)
      sum += D[r][p] *= det * WEIGHTS[p];
    w[MEANS + r] = sum[0] + sum[1] + sum[2] + sum[3];
  }
  for (int q = 0; q < N_POINTS; ++q)
    for (int L = 0; L < 3; ++L)
      for (int v = 0; v < V; ++v)
        G[3 * q + L][v] = K[0][L] * POINT_SLOPES[q][0][v] + K[1][L] * POINT_SLOPES[q][1][v] + K[2][L] * POINT_SLOPES[q][2][v];
  for (int i = 0; i < 3; ++i)
    for (int k = i; k < 3; ++k)
    {
      for (int q = 0; q < N_POINTS; ++q)
        for (int J = 0; J < 3; ++J)
        {
          double d[3];
          for (int L = 0; L < 3; ++L)
            d[L] = D[upper(3 * i + J, 3 * k + L)][q / LANES][q % LANES];
          for (int v = 0; v < V; ++v)
            T[3 * q + J][v] = d[0] * G[3 * q][v] + d[1] * G[3 * q + 1][v] + d[2] * G[3 * q + 2][v];
        }
      for (int a = 0; a < N; ++a)
      {
        vector sum[V];
        for (int v = 0; v < V; ++v)
          sum[v] = (i == k ? w[MEANS + UPPER] : 0.0) * MASS[a][v];
        for (int r = 0; r < 3 * N_POINTS; ++r)
          for (int v = 0; v < V; ++v)
            sum[v] += G[r][a / LANES][a % LANES] * T[r][v];
        for (int b = 0; b < N; ++b)
        {
          const double value = sum[b / LANES][b % LANES];
          A[3 * N * (3 * a + i) + 3 * b + k] += value;
          if (i != k)
            A[3 * N * (3 * b + k) + 3 * a + i] += value;
        }
      }
    }
}

// The tangent in linear displacements
void coarse_tangent(double* restrict A, double* w, const double* c, const double* x, const int* entity, const uint8_t* permutation, void* data)
{
  enum { N = 4 };
  const double* D = w + MEANS;
  double K[3][3], G[N][3];
  invert(x, K);
  for (int L = 0; L < 3; ++L)
  {
    G[0][L] = -K[0][L] - K[1][L] - K[2][L];
    for (int m = 0; m < 3; ++m)
      G[m + 1][L] = K[m][L];
  }
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k)
      for (int b = 0; b < N; ++b)
      {
        double T[3];
        for (int J = 0; J < 3; ++J)
          T[J] = D[upper(3 * i + J, 3 * k)] * G[b][0] + D[upper(3 * i + J, 3 * k + 1)] * G[b][1] + D[upper(3 * i + J, 3 * k + 2)] * G[b][2];
        for (int a = 0; a < N; ++a)
          A[3 * N * (3 * a + i) + 3 * b + k] += G[a][0] * T[0] + G[a][1] * T[1] + G[a][2] * T[2] + (i == k ? D[UPPER] * (a == b ? 2 : 1) / 120 : 0.0);
      }
}

// Adds the matrices of cells to values at their places, of each pair of nodes one, where three columns follow, or one for each row; without
// the rows and columns of the unknowns whose bits are set in `fixed`.
typedef void kernel(double* restrict, double*, const double*, const double*, const int*, const uint8_t*, void*);
static inline __attribute__((always_inline)) void add(kernel of, int N, const struct cells* cells, int rows, const int* restrict places, double* restrict values)
{
  double A[9 * N * N], x[12];
  for (int at = 0; at < cells->n; ++at, places += rows * N * N)
  {
    for (int e = 0; e < rows * N * N; ++e)
      __builtin_prefetch(values + places[e], 1);
    const int cell = cells->numbers[at];
    for (int v = 0; v < 4; ++v)
      memcpy(x + 3 * v, cells->points + 3 * cells->vertices[4 * cell + v], 3 * sizeof(double));
    memset(A, 0, sizeof(A));
    of(A, cells->w + (size_t)cell * cells->width, cells->constants, x, 0, 0, 0);
    for (int r = 0; cells->fixed[at] >> r; ++r)
      if (cells->fixed[at] >> r & 1)
        for (int s = 0; s < 3 * N; ++s)
          A[3 * N * r + s] = A[3 * N * s + r] = 0.0;
    for (int a = 0; a < N; ++a)
      for (int b = 0; b < N; ++b)
        for (int i = 0; i < 3; ++i)
        {
          double* to = values + places[rows * (N * a + b) + (rows == 1 ? 0 : i)];
          for (int k = 0; k < 3; ++k)
            to[rows == 1 ? 3 * k + i : k] += A[3 * N * (3 * a + i) + 3 * b + k];
        }
  }
}

void add_tangent(const struct cells* cells, int rows, const int* places, double* values)
{
  rows == 1 ? add(tangent, 10, cells, 1, places, values) : add(tangent, 10, cells, 3, places, values);
}

void add_coarse_tangent(const struct cells* cells, int rows, const int* places, double* values)
{
  rows == 1 ? add(coarse_tangent, 4, cells, 1, places, values) : add(coarse_tangent, 4, cells, 3, places, values);
}
