# docker build -t tongue_fenicsx .
# docker run --rm -v "$PWD/runs:/work/runs" tongue_fenicsx run demos/ggp.toml -o runs/ggp
FROM python:3.13-slim-bookworm
RUN apt-get update \
 && apt-get install -y --no-install-recommends gcc libc6-dev libglu1-mesa libxft2 libxcursor1 libxinerama1 libgl1 libegl1 \
 && rm -rf /var/lib/apt/lists/*
WORKDIR /work
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY tongue_fenicsx ./tongue_fenicsx
RUN pip install --no-cache-dir -c constraints.txt '.[wheel]'
COPY demos ./demos
ENV OMP_NUM_THREADS=1
RUN tongue build -o meshes/tongue_coarse.msh --preset coarse
ENTRYPOINT ["tongue"]
CMD ["--help"]
