# docker build -t tongue_fenicsx .
# docker run --rm -v "$PWD/runs:/work/runs" --user "$(id -u):$(id -g)" tongue_fenicsx run demos/ggp.toml -o runs/ggp
# docker run --rm --entrypoint mpiexec -v "$PWD/runs:/work/runs" tongue_fenicsx -n 2 tongue run demos/ggp.toml -o runs/ggp
FROM debian:trixie-slim AS build
RUN apt-get update && apt-get install -y --no-install-recommends python3-venv
WORKDIR /src
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY tongue_fenicsx ./tongue_fenicsx
RUN python3 -m venv /opt/tongue && /opt/tongue/bin/pip install --no-cache-dir -c constraints.txt '.[wheel]'

FROM debian:trixie-slim
# gcc compiles forms that are not in the image yet; the others are what Gmsh and VTK load
RUN apt-get update \
 && apt-get install -y --no-install-recommends python3-dev gcc libc6-dev libglu1-mesa libxft2 libxcursor1 libxinerama1 libgl1 libegl1 \
 && rm -rf /var/lib/apt/lists/* \
 && useradd --create-home tongue && mkdir -p /work/runs && chown tongue /work /work/runs
COPY --from=build /opt/tongue /opt/tongue
ENV PATH=/opt/tongue/bin:$PATH OMP_NUM_THREADS=1 XDG_CACHE_HOME=/work/.cache MPLCONFIGDIR=/work/.cache/matplotlib
USER tongue
WORKDIR /work
COPY --chown=tongue demos ./demos
# the mesh of the demos, and the compiled forms of make demo and of the two kinds that most others are: free and in contact; anyone may use
# the cache
RUN tongue build -o meshes/tongue_coarse.msh --preset coarse \
 && for demo in ggp sequence say_t; do tongue run demos/$demo.toml -o /tmp/$demo --set time.end=0.01 --no-figures && rm -r /tmp/$demo || exit 1; done \
 && chmod -R a+rwX .cache
ENTRYPOINT ["tongue"]
CMD ["--help"]
